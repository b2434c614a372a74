"""A long clip needs no more of anything at its end than at its beginning."""

from pathlib import Path

import pytest

from tests.robustness.soak import quarters, soaked

_MORE = 1.1  # of memory in the last quarter, against the second


@pytest.mark.long
def test_memory_handles_and_temporary_files_are_flat_over_10_000_frames(tmp_path: Path) -> None:
    rows = {str(row["soak"]): row for row in quarters(soaked(tmp_path, 10_000))}
    for stage in ("restoring", "encoding"):
        early, late = rows[f"{stage}, quarter 2"], rows[f"{stage}, quarter 4"]
        assert late["memory_mb"] <= _MORE * early["memory_mb"]
        assert late["handles"] <= early["handles"]
        assert late["temporary"] <= early["temporary"]
