"""Changed inputs of every reader and verb, and whether they are refused as they should be: `python -m tests.fuzz`.

seeds       small inputs that are sound
verbs       command lines that read them
trees       changes to TOML and JSON
tables      changes to CSV and Parquet
chunks      changes to PNG and AVI
mutate      which of them a file, or a command line, gets in one trial
readers     files read without a command, and what is wrong with how they were read
guided      one reader under atheris, where that is installed
trial       one changed command in a process of its own, and what is wrong with how it ended
"""
