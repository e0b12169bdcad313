"""Files: whole or not at all, with harmless names; those that people write, and those that a spreadsheet opens."""
