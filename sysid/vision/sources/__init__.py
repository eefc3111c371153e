"""What frames are read from: video files and folders of pictures, with the times at which pictures were taken.

pictures       pictures as OpenCV reads them, quietly, from files and captures
video          a file that OpenCV reads, with its time stamps
picture_files  a sequence of pictures, with or without a file of times beside them
frame_times    from time stamps to times: an even rate, or the stamps as they are
times          a file of times beside pictures
"""
