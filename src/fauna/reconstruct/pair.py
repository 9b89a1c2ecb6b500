"""Two photographs and what is made of both: what morphs and transfers of a pose have in common."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from fauna.errors import FaunaError
from fauna.reconstruct.result import Fit, Result
from fauna.reconstruct.status import Status


@dataclass(frozen=True, eq=False)
class Pair:
    """Two results of one model.

    Attributes:
        name: of what is made of them, and of its folder.
        first: of one photograph.
        second: of the other.
        seconds: by stage, of both.
    """

    name: str
    first: Result
    second: Result
    seconds: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.first.weights != self.second.weights:
            names = f"{self.first.weights.name} and {self.second.weights.name}"
            raise FaunaError(f"{self.name}: expected two results of one model, got {names}; use the same weights")

    @property
    def worst(self) -> Result:
        """The one whose status holds for both: the first without an animal, else the first that is not ``ok``, else the less sure one."""
        both = sorted((self.first, self.second), key=lambda each: each.confidence)
        for unlike in (lambda each: each.fit is None, lambda each: not each.ok):
            for each in (self.first, self.second):
                if unlike(each):
                    return each
        return both[0]

    @property
    def status(self) -> Status:
        """``ok`` when both are."""
        return self.worst.status

    @property
    def reason(self) -> str:
        """One line that names the photograph; empty when the status is ``ok``."""
        reason = self.worst.reason
        return reason if not reason or reason.startswith(self.worst.name) else f"{self.worst.name}: {reason}"

    @property
    def flags(self) -> tuple[str, ...]:
        """Of either."""
        return tuple(dict.fromkeys((*self.first.flags, *self.second.flags)))

    @property
    def confidence(self) -> float:
        """The smaller one."""
        return min(self.first.confidence, self.second.confidence)

    @property
    def ok(self) -> bool:
        """Whether the status is ``ok``."""
        return self.status == "ok"

    @cached_property
    def fits(self) -> tuple[Fit, Fit]:
        """Both animals.

        Raises:
            FaunaError: when there are not two.
        """
        if self.first.fit is None or self.second.fit is None:
            raise FaunaError(
                f"{self.name}: expected two reconstructed animals, got none ({self.status}: {self.reason}); use another photograph"
            )
        return self.first.fit, self.second.fit
