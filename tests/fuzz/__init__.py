"""Damaged inputs of every verb, and whether it refuses them as it should: `python -m tests.fuzz`.

seeds       small inputs that are sound
verbs       command lines that read them
damage      what slips, accidents and hostile hands do to files and options
readers     the same files read in this process, without a command, and what is wrong with how they were read
guided      one reader under atheris, where that is installed
trial       one damaged command in a process of its own, and what is wrong with how it ended
"""
