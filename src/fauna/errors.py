"""The one exception type for anything a user can cause and mend."""


class FaunaError(Exception):
    """Bad input. The message is one line: what was expected, what came, what to do."""
