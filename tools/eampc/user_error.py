"""Errors that a user can mend: one sentence each, printed without a traceback by
`command_line.main`.
"""


class UserError(Exception):
    """Bad input: the sentence says what, where and how to mend it. Exit code 2."""

    exit_code = 2


class RunFailed(UserError):
    """The input was fine, but the run did not end well. Exit code 1."""

    exit_code = 1
