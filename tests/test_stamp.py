"""Kernels that were compiled from other sources are not used again."""

from __future__ import annotations

from pathlib import Path

from inscrutable.kernels.stamp import forget_other_sources


def test_kernels_of_other_sources_are_forgotten(tmp_path: Path) -> None:
    source, kept = tmp_path / "one.py", tmp_path / "__pycache__"
    source.write_text("a = 1\n", "utf-8")
    forget_other_sources(tmp_path)
    compiled = [kept / "one.f-1.py311.nbi", kept / "one.f-1.py311.1.nbc"]
    for path in compiled:
        path.write_bytes(b"kept")
    forget_other_sources(tmp_path)
    assert all(path.exists() for path in compiled), "the same sources"
    source.write_text("a = 22\n", "utf-8")
    forget_other_sources(tmp_path)
    assert not any(path.exists() for path in compiled)
    other = tmp_path / "two.py"
    for path in compiled:
        path.write_bytes(b"kept")
    other.write_text("", "utf-8")
    forget_other_sources(tmp_path)
    assert not any(path.exists() for path in compiled)


def test_kernels_of_other_tolerances_are_forgotten(tmp_path: Path) -> None:
    sources, numbers = tmp_path / "kernels", tmp_path / "tolerances.py"
    compiled = sources / "__pycache__" / "one.f-1.py311.nbi"
    compiled.parent.mkdir(parents=True)
    numbers.write_text("A = 1e-9\n", "utf-8")
    forget_other_sources(sources)
    compiled.write_bytes(b"kept")
    forget_other_sources(sources)
    assert compiled.exists(), "the same numbers"
    numbers.write_text("A = 1e-10\n", "utf-8")
    forget_other_sources(sources)
    assert not compiled.exists()
