"""Words for people, in one place for page, terminal and index: sentences, titles, units, number formats."""
