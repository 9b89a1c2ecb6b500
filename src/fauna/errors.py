"""The one exception type for anything a user can cause and mend."""


class FaunaError(Exception):
    """Bad input. The message is one line: what was expected, what came, what to do."""


class Interrupted(FaunaError):
    """A signal ended the training; the message says how to go on.

    Attributes:
        exit_code: 130 after an interrupt from the keyboard, 143 after a request to terminate.
    """

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        self.exit_code = exit_code
