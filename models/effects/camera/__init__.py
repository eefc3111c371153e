"""How the camera reports the balls: geometry of the image, and its time stamps."""
