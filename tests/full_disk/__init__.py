"""A disk that is full at random bytes: every verb that writes ends with one line of ours, and leaves nothing by halves.

works       command lines that write, on tiny inputs
disk        a disk with so much room: a file system of its own, or a limit on files where none may be mounted
known       computations that only the undisturbed run does
whole       whether a file is whole, by its kind
course      one command on disks of different room, and what is wrong with how it ended
"""
