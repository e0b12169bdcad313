"""Gates over many logs, for CI: JUnit, annotations, summaries."""
