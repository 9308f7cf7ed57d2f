"""Viewpoints: reading CSV files, refusing with the line, and the distribution of our own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from nablahog.paper.viewpoints import read_viewpoints, sample_viewpoints


def _csv(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    path = folder / "views.csv"
    path.write_bytes(text.encode(encoding))
    return path


def test_columns_by_name(tmp_path: Path) -> None:
    path = _csv(tmp_path, 'id,elevation,azimuth,note\na,20.5,-30,x\nb,-90,370,"y,z"\n')
    np.testing.assert_allclose(read_viewpoints(path), [[330, 20.5, 0], [10, -90, 0]])


def test_theta_is_optional(tmp_path: Path) -> None:
    path = _csv(tmp_path, "azimuth, elevation, theta\r\n0, 10, -5\r\n", "utf-8-sig")
    np.testing.assert_allclose(read_viewpoints(path), [[0, 10, -5]])


def test_azimuth_stays_below_360(tmp_path: Path) -> None:
    azimuth = read_viewpoints(_csv(tmp_path, "azimuth,elevation\n-1e-20,0\n360,0\n-360,0\n359.5,0\n"))[:, 0]
    np.testing.assert_array_equal(azimuth, [0, 0, 0, 359.5])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: expected the columns azimuth and elevation, but azimuth and elevation is missing"),
        ("azimuth,height\n1,2\n", "line 1: .* but elevation is missing"),
        ("azimuth,elevation\n", "at least one viewpoint"),
        ("azimuth,elevation\n1,2\n3,x\n", "line 3: expected a finite number of degrees as elevation, got 'x'"),
        ("azimuth,elevation\n1,2\n\n3,\n", "line 4: .* as elevation, got ''"),
        ("azimuth,elevation\n1\n", "line 2: .* as elevation, got None"),
        ("azimuth,elevation\nnan,2\n", "line 2: .* as azimuth, got 'nan'"),
        ("azimuth,elevation\n1,2\ninf,2\n", "line 3: .* as azimuth, got 'inf'"),
        ("azimuth,elevation,theta\n1,2,\n", "line 2: .* as theta, got ''"),
        ("azimuth,elevation\n1,90.5\n", "line 2: elevation must lie in -90…90 degrees, got 90.5"),
        ('azimuth,elevation\n1,"2\n' + 140_000 * "x", "field larger than field limit"),
    ],
)
def test_refused_with_the_line(tmp_path: Path, text: str, message: str) -> None:
    path = _csv(tmp_path, text)
    with pytest.raises(ValueError, match=message) as caught:
        read_viewpoints(path)
    assert str(caught.value).startswith(str(path))


def test_no_csv_file(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no such file"):
        read_viewpoints(tmp_path / "none.csv")
    with pytest.raises(ValueError, match="got a folder"):
        read_viewpoints(tmp_path)
    (tmp_path / "picture.csv").write_bytes(b"\x89PNG\r\n\x1a\n\xff\xfe")
    with pytest.raises(ValueError, match=r"picture.csv, line 1: .* can't decode"):
        read_viewpoints(tmp_path / "picture.csv")


def test_samples_cover_all_sides_and_favour_the_front() -> None:
    views = sample_viewpoints(20_000, np.random.default_rng(0))
    azimuth, elevation, theta = views.T
    counts = np.histogram(azimuth, bins=8, range=(0, 360))[0]
    assert counts.sum() == len(views)
    assert counts.min() > 1000
    assert counts[0] > 2 * counts[3]
    assert counts[7] > 2 * counts[4]
    assert 0 <= elevation.min() < 5
    assert 35 < elevation.max() <= 45
    assert elevation.mean() == pytest.approx(20, abs=0.5)
    assert theta.std() == pytest.approx(3, rel=0.05)


def test_samples_depend_on_the_generator_only() -> None:
    a, b, c = (sample_viewpoints(5, np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(a, b)
    assert not np.allclose(a, c)
