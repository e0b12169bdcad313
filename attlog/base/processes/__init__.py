"""Functions called in other processes: one way to start them, to talk to them, to limit and to end them.

``child`` starts a fresh interpreter or takes a process that was forked, calls functions there within limits of time
and memory, and says how it died. ``serve`` is the other side. ``wire`` carries values between both. ``forks`` has one
program with everything imported that only forks (``server``). ``pool`` does the same work on several things.
"""
