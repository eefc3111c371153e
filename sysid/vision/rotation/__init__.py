"""How balls turn, from the marks that pictures show of them."""
