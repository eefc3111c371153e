"""Which detection is which ball: followed from frame to frame, through impacts, and back where a pack broke."""
