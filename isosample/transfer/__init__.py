"""Transfer functions and the isovalues they need: what is visible."""
