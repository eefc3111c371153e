"""Files of effects as a user writes them, held against the contract."""

from __future__ import annotations

from pathlib import Path

from models.contract.checks import faults
from models.effect_catalogue import add_folder, effect_class


def file_faults(path: Path) -> list[str]:
    """All faults of the effects in a file or folder, each with its effect's name."""
    return [f"{name}: {text}" for name in add_folder(path) for text in faults(effect_class(name))]
