"""The camera over the table: its projection and file, and calibration from the table itself or a chessboard.

In: pictures of the table, its size, what is known of the camera. Out: `Camera`, `Calibration`.

    projection, pose    table to pixels and back; a camera fitted to points of the table
    board               the lens from a chessboard
    printed             markers on the cushions
    table               what a picture shows of the table
    calibrate, trust    the camera that fits best, and how far it is known
    camera_motion       whether it stands where it stood
    pictures            what people see of it
"""
