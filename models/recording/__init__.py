"""What goes to Rerun: shots and their plays, plans, series and videos. Only these modules import it."""
