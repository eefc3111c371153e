"""Tracks of other programs as clips: read, understood, converted, drawn.

In: CSV, JSON or Parquet files of any tracker, or a clip set whose entries are wrong. Out: a `ClipSet`, what was
assumed, and a picture of it.

    records     files as rows of named cells
    columns     the meaning of columns: one row per ball, or one row per frame
    times       seconds, frames or parts of a second
    stated      what the user states about them
    placing     units, origin, axes: the likeliest reading
    convert     files to a clip set; the struck ball and its strike
    pixels      positions in a picture, converted by a camera
    picture     the tracks over the table
"""
