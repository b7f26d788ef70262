"""The checker finds the fault in every faulty core, and none in the same core without it."""

from pathlib import Path

import pytest

from .builds import build_faulty_driver, compile_as_one_file, faulty_text
from .checker import describe, find_anomaly
from .faults import FAULTS, FAULTY_HISTORIES, HISTORIES, SOUND, Fault
from .history import record, runs

pytestmark = pytest.mark.timeout(600)


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS, ids=lambda f: f.name)
def test_a_fault_is_found(fault: Fault, tmp_path: Path) -> None:
    driver = build_faulty_driver(fault)
    for concurrency in fault.modes:
        for plain in runs(concurrency, FAULTY_HISTORIES):
            run = plain._replace(reads=fault.reads)
            history = record(driver, run, tmp_path / "history")
            if anomaly := find_anomaly(history):
                print(f"\n{run}\n{describe(history, anomaly)}")
                break
        else:
            pytest.fail(f"not found in {FAULTY_HISTORIES} histories, {concurrency}")


@pytest.mark.parametrize("fault", FAULTS + SOUND, ids=lambda f: f.name)
def test_a_fault_still_fits_the_core(fault: Fault) -> None:
    """The patched text occurs once, so that each fault applies even when it is not built here."""
    assert faulty_text(fault)


@pytest.mark.slow
def test_the_core_compiles_as_one_file(tmp_path: Path) -> None:
    """Else no fault is built: names in anonymous namespaces must not be those of other files."""
    assert compile_as_one_file(tmp_path) == ""


@pytest.mark.slow
@pytest.mark.parametrize("sound", SOUND, ids=lambda f: f.name)
def test_without_a_fault_none_is_found(sound: Fault, tmp_path: Path) -> None:
    driver = build_faulty_driver(sound)
    for concurrency in sound.modes:
        for run in runs(concurrency, HISTORIES):
            history = record(driver, run, tmp_path / "history")
            anomaly = find_anomaly(history)
            assert anomaly is None, f"{run}\n{describe(history, anomaly)}"
