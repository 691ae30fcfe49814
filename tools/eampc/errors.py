"""Errors of the offline part that a user can mend, one sentence each, exit code 2."""

from eampc.user_error import UserError


class EampcError(UserError):
    """Base of the errors below."""


class DesignError(EampcError, ValueError):
    """No law can be designed from this rig: what stands in the way and what to change."""


class LawFileError(EampcError, ValueError):
    """A law file that cannot be used: which, what is wrong, what to do."""
