"""Balls in single pictures: the table without them, their colours, where their outlines are."""
