"""The blocks of a series, that is, the shots between two refits, and the changes of effects by refits."""

from __future__ import annotations

from dataclasses import dataclass

from robot.learning.history import History

Block = tuple[int, int]  # first and last shot, counted from 1

DEFAULT_BLOCK_SHOTS = 10  # used if the series has no setting


@dataclass(frozen=True)
class Change:
    """The effects that a refit added and dropped."""

    shots: int  # number of shots that it was fitted to
    added: tuple[str, ...]
    dropped: tuple[str, ...]


def block_size(story: History) -> int:
    """Number of shots between refits."""
    return max(int(story.course.get("every") or DEFAULT_BLOCK_SHOTS), 1)


def blocks(story: History) -> list[Block]:
    """All blocks of a series; the last may be incomplete."""
    count, step = len(story.shots), block_size(story)
    return [(first, min(first + step - 1, count)) for first in range(1, count + 1, step)]


def ends(story: History) -> list[Block]:
    """The first block and the last that is at least half complete; one block, or none, in a short series."""
    all_blocks, step = blocks(story), block_size(story)
    whole = [(first, last) for first, last in all_blocks if 2 * (last - first + 1) >= step] or all_blocks[:1]
    return [whole[0], whole[-1]] if len(whole) > 1 else whole


def changes(story: History) -> list[Change]:
    """The effects that every refit added and dropped, relative to the one before."""
    out, before = [], set[str]()
    for refit in story.refits:
        added = tuple(name for name in refit.verdict if name not in before)
        out.append(Change(refit.shots, added, tuple(sorted(before - set(refit.verdict)))))
        before = set(refit.verdict)
    return out


def pot_count(story: History, block: Block) -> tuple[float, int, int]:
    """Pots expected by the plans, actual pots, and number of shots, of potting shots whose end was seen."""
    seen = [shot for shot in story.played_to_pot(*block) if shot.potted is not None]
    return sum(shot.pot_probability for shot in seen), sum(bool(shot.potted) for shot in seen), len(seen)
