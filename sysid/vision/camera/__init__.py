"""The camera over the table: its projection and file, and calibration from the table itself or a chessboard."""
