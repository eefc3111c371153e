"""Tracks of other programs as clips: read, understood, converted, drawn.

In: CSV, JSON or Parquet files of any tracker, or a clip set whose entries are wrong. Out: a `ClipSet`, what was taken
for granted, and a picture of it.

    records     files as rows of named cells
    columns     which column is what: one row a ball, or one row a frame
    times       seconds, frames or parts of a second
    convert     units, origin, axes; the struck ball and its strike
    pixels      places in a picture, by a camera
    picture     the tracks over the table
"""
