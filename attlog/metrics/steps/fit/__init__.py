"""The fit of a lag: one linear model of all steps together."""
