"""What can go wrong, as one small family of exceptions.

Every error that attlog expects derives from :class:`AttlogError` and carries the
process exit code that the command line ends with (sysexits numbering, see
``docs/cli.md``). Messages are one or two sentences: what, where, what to do.
"""

from __future__ import annotations


class AttlogError(Exception):
    """Root of all errors that attlog raises on purpose."""

    exit_code = 70


class UsageError(AttlogError):
    """The call, an option or a configuration file is wrong."""

    exit_code = 2


class LogUnusable(AttlogError):
    """The file is readable but holds nothing that can be analysed."""

    exit_code = 65


class NotALog(LogUnusable):
    """The content is none of the supported log formats."""


class LogUnreadable(AttlogError):
    """The file does not exist or cannot be opened."""

    exit_code = 66


class OutputError(AttlogError):
    """A result cannot be written."""

    exit_code = 73


class PluginError(AttlogError):
    """A user's estimator file cannot be loaded or breaks the estimator contract."""

    exit_code = 2
