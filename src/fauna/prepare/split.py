"""Who is trained on: the paper's rules, without a leak by photograph, video or near duplicate."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace

from fauna.errors import FaunaError
from fauna.prepare.record import Record
from fauna.prepare.settings import SplitSettings
from fauna.random import derive_seed

STEP = "split"
TRAIN, VAL, TEST, BACK = "train", "val", "test", "back"


@dataclass
class Members:
    """The usable animals of a set, counted.

    Attributes:
        of_species: by species, how many animals each cluster has.
        species_of: by cluster, its species.
    """

    of_species: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    species_of: dict[str, set[str]] = field(default_factory=lambda: defaultdict(set))

    def add(self, species: str, cluster: str) -> None:
        """Count an animal."""
        self.of_species[species][cluster] += 1
        self.species_of[cluster].add(species)


@dataclass(frozen=True)
class Split:
    """A split of clusters.

    Attributes:
        of_cluster: ``val`` or ``test``; every other cluster is for training.
        left_out: species with too few photographs.
        joint: clusters of several usable animals, which lie in a folder of their own.
    """

    of_cluster: dict[str, str]
    left_out: frozenset[str]
    joint: frozenset[str]


def choose_split(members: Members, settings: SplitSettings) -> Split:
    """Set clusters aside.

    All photographs of held-out species are test photographs, and so are those of other species that share a photograph, video or
    near duplicate with them. Few-shot species (fewer than ``few_shot_below`` animals) give ``few_shot_val`` animals for validation, others a
    fraction. Clusters are taken in an order that depends on the seed and their names only, so that new photographs do not stir up the old
    ones; one that is larger than what is still wanted is passed over, and taken only where nothing smaller is left.

    Args:
        members: usable animals.
        settings: the rules.

    Raises:
        FaunaError: for a held-out species that is not there.
    """
    unknown = sorted(set(settings.held_out) - set(members.of_species))
    if unknown:
        known = ", ".join(sorted(members.of_species)) or "none"
        raise FaunaError(
            f"split.held_out: expected species of the set ({known}), got {', '.join(unknown)}; mend the list"
        )
    few = frozenset(name for name, each in members.of_species.items() if each.total() < settings.min_photos)
    chosen = {cluster: TEST for name in settings.held_out for cluster in members.of_species[name]}
    spare = {
        name: sum(size for cluster, size in each.items() if cluster not in chosen) - settings.min_train
        for name, each in members.of_species.items()
        if name not in few and name not in settings.held_out
    }
    for name in sorted(spare):
        total = members.of_species[name].total()
        if total < settings.few_shot_below:
            sizes = {VAL: settings.few_shot_val, TEST: settings.few_shot_test}
        else:
            sizes = {VAL: round(settings.val_fraction * total), TEST: round(settings.test_fraction * total)}
        for split, wanted in sizes.items():
            _choose(members, chosen, spare, split, wanted, name, settings.seed)
    joint = frozenset(
        cluster
        for cluster, species in members.species_of.items()
        if sum(members.of_species[name][cluster] for name in species - few) > 1
    )
    return Split(chosen, few, joint)


def assigned(rows: Iterable[Record], split: Split, back_views: frozenset[str]) -> Iterator[Record]:
    """The rows with their split.

    Args:
        rows: of any part of the set.
        split: of the set.
        back_views: ids or sources of animals seen from behind; among training photographs they become back views.
    """
    for row in rows:
        if not row.ok:
            yield row
        elif row.species in split.left_out:
            yield row.rejected(STEP, "few_photos")
        else:
            part = split.of_cluster.get(cluster_of(row), TRAIN)
            seen_from_behind = part == TRAIN and not back_views.isdisjoint((row.id, row.photo, row.source))
            yield replace(row, split=BACK if seen_from_behind else part)


def cluster_of(row: Record) -> str:
    """What must stay in one split with the row."""
    return row.cluster or row.photo


def _choose(
    members: Members, chosen: dict[str, str], spare: dict[str, int], split: str, wanted: int, species: str, seed: int
) -> None:
    """Add clusters of a species to ``chosen``; what other species chose already counts.

    A cluster that animals of other species share is taken only where each of them can spare its own.

    Args:
        members: usable animals.
        chosen: split by cluster; clusters are added.
        spare: by species, how many animals may still be set aside; brought up to date.
        split: ``val`` or ``test``.
        wanted: animals of the species.
        species: whose turn it is.
        seed: of the order.
    """
    clusters = members.of_species[species]
    wanted -= sum(size for cluster, size in clusters.items() if chosen.get(cluster) == split)
    free = [cluster for cluster in clusters if cluster not in chosen]
    order = sorted(free, key=lambda cluster: derive_seed(seed, split, species, cluster))

    def can_be_spared(cluster: str) -> bool:
        sharing = members.species_of[cluster] & spare.keys()
        return all(members.of_species[name][cluster] <= spare[name] for name in sharing)

    def take(cluster: str) -> None:
        chosen[cluster] = split
        for name in members.species_of[cluster] & spare.keys():
            spare[name] -= members.of_species[name][cluster]

    start = wanted
    for cluster in order:
        if clusters[cluster] <= wanted and can_be_spared(cluster):
            take(cluster)
            wanted -= clusters[cluster]
    if wanted == start > 0:  # every cluster is larger than what is wanted: the smallest one, if there are others
        left = [cluster for cluster in order if can_be_spared(cluster)]
        smallest = min(left, key=lambda cluster: (clusters[cluster], order.index(cluster)), default=None)
        if smallest is not None:
            take(smallest)
