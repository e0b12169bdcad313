"""One drawing function per kind of figure, by what the figure is about."""
