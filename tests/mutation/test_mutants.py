"""The mutations still fit the core, also where `make mutants` is not run."""

from __future__ import annotations

from pathlib import Path

import pytest

from .core import MUTANTS, Mutant

CORE = Path(__file__).resolve().parents[2] / "zenoh_tf/core"


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.what)
def test_a_mutated_decision_is_there_once(mutant: Mutant) -> None:
    assert (CORE / mutant.file).read_text().count(mutant.old) == 1
