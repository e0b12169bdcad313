"""Which questions can a log answer, before any filter runs?"""
