"""Opening the photograph of a row, once for every step that looks at it."""

from fauna.prepare.record import Record
from fauna.prepare.settings import Settings
from fauna.prepare.workspace import Workspace
from fauna.reconstruct.photograph import Photograph, read_photograph


def open_photograph(row: Record, settings: Settings, workspace: Workspace) -> Photograph:
    """The upright photograph of a row at working size; :attr:`~fauna.reconstruct.photograph.Photograph.scale` leads to full size.

    Raises:
        Refused: with a status that is a word of :data:`fauna.prepare.reasons.REASONS`, when it cannot be used.
    """
    return read_photograph(workspace.photo(row.source), settings.photo)
