"""A small share of the benchmark of imports: what it measures is right, memory is bounded, views read little."""

from __future__ import annotations

from pathlib import Path

from bench import imports


def test_an_import_is_exact_and_views_of_every_length_are_answered() -> None:
    job, views = imports.jobs(runs=1, megabytes=0.5, samples=200_000)
    assert [row.who for row in job.rows] == ["this service", "npTDMS"]
    assert job.rows[0].error == 0.0
    assert [row.who for row in views.rows] == ["200,000 samples", "100,000 samples", "12,500 samples"]


def test_the_memory_of_an_import_does_not_grow_with_the_file(tmp_path: Path) -> None:
    """Two files, one six times the other; the issue's gigabyte is `python -m bench.imports --peak 1000`."""
    used = []
    for count in (200_000, 1_200_000):
        path = tmp_path / f"{count}.tdms"
        imports._write(path, count)
        used.append(imports.peak(path, "tdms")[1])
        path.unlink()
    assert used[1] < 500
    assert used[1] - used[0] < 60  # the larger file has 32 MB more of them
