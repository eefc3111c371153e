"""Kills at random moments: finished work stays, no process does, and the same command ends as if nothing had been.

works       commands that continue, on tiny inputs
course      one command, killed again and again until it has ended, and what was lost on the way
"""
