"""Display texts of page, terminal and index: sentences, titles, units, number formats."""
