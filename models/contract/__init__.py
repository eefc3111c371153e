"""The contract of every effect, shipped or a user's: checks, each of which returns its faults, one line each."""

from models.contract.checks import CONTRACTS, kept

__all__ = ["CONTRACTS", "kept"]
