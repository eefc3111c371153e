"""When pictures were taken, where the stamps of their file do not say: doubled, missing, picked, or at another rate."""
