"""Steps (fast attitude changes): which there are, and how a row follows them."""
