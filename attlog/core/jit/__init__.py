"""Loops as machine code: plain functions in, object code out, called without the compiler."""
