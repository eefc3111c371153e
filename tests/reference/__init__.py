"""Published formulas and figures that only tests hold the project against."""
