"""The one exception that is the user's to mend."""


class UserError(Exception):
    """Bad input or configuration.

    The message is one plain sentence: what was wrong, where (file or key), and what to do.
    The command line prints it without a traceback and exits with status 2.
    """
