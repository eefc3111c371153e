"""What goes to Rerun: shots and their films, plans, series, campaigns; and its viewer. Only these modules import it."""
