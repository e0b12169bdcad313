"""Answers for assistants that call tools (Model Context Protocol): small, structured, read-only."""
