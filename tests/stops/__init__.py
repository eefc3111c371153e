"""Stops from outside at random moments of a series: the launcher stands in time, and says so.

rounds      one series on an emulated launcher, and what stops it: another shell, the controller's end, the cable
"""
