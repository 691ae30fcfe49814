"""Errors that a user can mend: one sentence each, printed without a traceback by
`command_line.run`. What is wrong with a rig file or a bus URL is eampc_rig.RigError.
"""


class UserError(Exception):
    """Bad input: the sentence says what, where and how to mend it. Exit code 2."""

    exit_code = 2


class RunFailed(UserError):
    """The input was fine, but the run did not end well. Exit code 1."""

    exit_code = 1


class DesignError(UserError, ValueError):
    """No law can be designed from this rig: what stands in the way and what to change."""


class LawFileError(UserError, ValueError):
    """A law file that cannot be used: which, what is wrong, what to do."""
