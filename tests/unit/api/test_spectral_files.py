"""Measured frequency responses in tables, MATLAB, HDF5, Parquet, Touchstone and FRD files: the numbers that were written."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io

from api.formats import FormatError, Recording
from api.formats.spectral.names import frequency_scale, meaning_of, points_of, units_of
from tests.support.recorded import arrays, closed_files, opened  # noqa: F401 - a fixture for all tests here

RNG = np.random.default_rng(29)
HZ = np.arange(1, 81) * 0.25
JW = 2j * np.pi * HZ
TIP = 1 / (JW**2 + 2 * 0.05 * 60 * JW + 60**2)
BASE = 0.3 / (JW**2 + 2 * 0.02 * 90 * JW + 90**2)
COHERENCE = 0.9 + 0.1 * np.cos(HZ)


def found(recording: Recording) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    return {one.name: one.read() for one in recording.functions}


def table(header: str, *columns: np.ndarray, mark: str = ",", decimal: str = ".") -> bytes:
    rows = [header]
    for cells in zip(*columns, strict=True):
        plain = [str(cell) if isinstance(cell, str) else repr(float(cell)) for cell in cells]
        rows.append(mark.join(cell.replace(".", decimal) for cell in plain))
    return ("\n".join(rows) + "\n").encode()


DB, DEG, RAD = 20 * np.log10(np.abs(TIP)), np.rad2deg(np.angle(TIP)), np.angle(TIP)
TEXTS = np.array([f"{value.real!r}{value.imag:+}i" for value in TIP.astype(object)])
ENGINEERS = np.array(
    [f"{value.real!r} {'-' if value.imag < 0 else '+'} j{abs(value.imag)!r}" for value in TIP.astype(object)]
)
TABLES: dict[str, bytes] = {
    "parts": table("Frequency [Hz],Re(tip/hammer) [mm/N],Im(tip/hammer) [mm/N],Coherence tip/hammer", HZ, TIP.real, TIP.imag, COHERENCE),
    "suffixes, decimal commas": table("freq (Hz);tip/hammer real (mm/N);tip/hammer imag (mm/N);tip/hammer coherence", HZ, TIP.real, TIP.imag, COHERENCE, mark=";", decimal=","),
    "kHz": table("f [kHz]\ttip/hammer re [mm/N]\ttip/hammer im [mm/N]\tcoh tip/hammer", HZ / 1000, TIP.real, TIP.imag, COHERENCE, mark="\t"),
    "rad/s": table("omega [rad/s]\ttip/hammer_re [mm/N]\ttip/hammer_im [mm/N]\tgamma2 tip/hammer", 2 * np.pi * HZ, TIP.real, TIP.imag, COHERENCE, mark="\t"),
    "degrees": table("Frequency (Hz),|tip/hammer| (mm/N),phase of tip/hammer (deg),msc tip/hammer", HZ, np.abs(TIP), DEG, COHERENCE),
    "radians": table("Frequency (Hz),mag tip/hammer (mm/N),phase tip/hammer (rad),coherence tip/hammer", HZ, np.abs(TIP), RAD, COHERENCE),
    "falling": table("Frequency [Hz],Re(tip/hammer) [mm/N],Im(tip/hammer) [mm/N],Coherence tip/hammer", HZ[::-1], TIP.real[::-1], TIP.imag[::-1], COHERENCE[::-1]),
    "complex cells": table("Frequency [Hz],tip/hammer [mm/N],Coherence tip/hammer", HZ, TEXTS, COHERENCE),
    "complex cells of engineers": table("Frequency [Hz];tip/hammer [mm/N];Coherence tip/hammer", HZ, ENGINEERS, COHERENCE, mark=";", decimal=","),
}  # fmt: skip


@pytest.mark.parametrize("layout", TABLES)
def test_a_table_over_frequency_holds_responses(layout: str, tmp_path: Path) -> None:
    recording = opened("csv", TABLES[layout], tmp_path)
    assert (list(recording.series), dict(recording.refused)) == ([], {})
    one, other = recording.functions
    assert (one.kind, one.response, one.reference, one.count) == ("frequency response", "tip", "hammer", 80)
    assert (one.response_unit, one.reference_unit) == ("mm", "N")
    assert (other.kind, other.response, other.reference) == ("coherence", "tip", "hammer")
    frequency, values = one.read()
    np.testing.assert_allclose(frequency, HZ, rtol=1e-14)
    np.testing.assert_allclose(values, TIP, rtol=1e-12)
    np.testing.assert_allclose(other.read()[1], COHERENCE, rtol=1e-14)


def test_decibels_are_of_a_ratio_whose_units_nobody_knows(tmp_path: Path) -> None:
    recording = opened(
        "csv", table("Frequency (Hz),Magnitude (dB),Phase (deg),Coherence", HZ, DB, DEG, COHERENCE), tmp_path
    )
    response, coherence = recording.functions
    np.testing.assert_allclose(response.read()[1], TIP, rtol=1e-12)
    assert (response.response, response.reference, response.response_unit) == ("response", "reference", "")
    assert (coherence.response, coherence.reference) == ("response", "reference")
    assert any("20 log10 of the magnitude" in said for said in recording.remarks)


@pytest.mark.parametrize(("phase", "factor"), [(DEG, 1.0), (RAD, 1.0)])
def test_an_angle_without_a_unit_is_told_by_its_size_and_said(phase: np.ndarray, factor: float, tmp_path: Path) -> None:
    recording = opened("csv", table("Frequency,Magnitude,Phase", HZ, np.abs(TIP), factor * phase), tmp_path)
    np.testing.assert_allclose(recording.functions[0].read()[1], TIP, rtol=1e-12)
    assert any("Phase has no unit" in said for said in recording.remarks)


def test_spectra_without_a_phase(tmp_path: Path) -> None:
    density = np.abs(TIP) ** 2
    recording = opened("txt", table("Frequency (Hz)\tPSD (V^2/Hz)", HZ, density, mark="\t"), tmp_path)
    (one,) = recording.functions
    assert (one.kind, one.response_unit) == ("power spectral density", "V^2/Hz")
    np.testing.assert_array_equal(one.read()[1], density)


@pytest.mark.parametrize(
    ("header", "options"),
    [
        ("F [N],x [mm]", {}),  # a force
        ("f,x", {}),  # nothing tells that f is a frequency
        ("time [s],Re(H)", {}),
        ("Frequency [Hz],x [mm]", {"over_time": True}),  # of a drive, said to be sampled
    ],
)
def test_recordings_over_time_stay_what_they_are(header: str, options: dict[str, bool], tmp_path: Path) -> None:
    recording = opened("csv", table(header, HZ, TIP.real), tmp_path, **options)
    assert not recording.functions
    assert len(recording.series) == 2


def test_lines_of_1_hz_are_no_sample_numbers(tmp_path: Path) -> None:
    (one,) = opened("csv", b"Frequency [Hz],H real,H imag\n1,2,5\n2,3,6\n3,4,7\n", tmp_path).functions
    frequency, values = one.read()
    np.testing.assert_array_equal(frequency, [1, 2, 3])
    np.testing.assert_array_equal(values, [2 + 5j, 3 + 6j, 4 + 7j])


def test_lines_without_a_value_are_missing(tmp_path: Path) -> None:
    (one,) = opened("csv", b"Frequency [Hz],H\n0,1+2i\n0.5,NaN\n1.5,\n2,3-i\n", tmp_path).functions
    values = one.read()[1]
    assert np.isnan(values).tolist() == [False, True, True, False]
    assert values[[0, 3]].tolist() == [1 + 2j, 3 - 1j]


def test_frequencies_that_come_twice_are_said_to_be_none(tmp_path: Path) -> None:
    recording = opened("csv", b"Frequency [Hz],H real,H imag\n1,2,5\n1,3,6\n3,4,7\n", tmp_path)
    assert not recording.functions
    assert "Frequency does not rise strictly" in recording.remarks[-1]


def test_a_speed_that_rises_and_falls_is_no_axis(tmp_path: Path) -> None:
    recording = opened("csv", table("Frequency [Hz],x [mm]", np.abs(HZ - 10), TIP.real), tmp_path)
    assert [one.name for one in recording.series] == ["Frequency", "x"]


def mat(**variables: object) -> bytes:
    target = io.BytesIO()
    scipy.io.savemat(target, variables)
    return target.getvalue()


def hdf5(**variables: object) -> bytes:
    target = io.BytesIO()
    with h5py.File(target, "w") as file:
        for name, value in variables.items():
            file[name] = value
    return target.getvalue()


def matlab73(**variables: np.ndarray) -> bytes:
    """As MATLAB writes it: columns are rows, complex numbers have the fields real and imag."""
    target = io.BytesIO()
    with h5py.File(target, "w", userblock_size=512) as file:
        for name, value in variables.items():
            array = np.atleast_2d(value).T if value.ndim == 1 else value
            if np.iscomplexobj(array):
                pair = np.empty(array.shape, dtype=[("real", "<f8"), ("imag", "<f8")])
                pair["real"], pair["imag"] = array.real, array.imag
                array = pair
            file[name] = array.T
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    content = bytearray(target.getvalue())
    content[:128] = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    return bytes(content)


CONTAINERS: dict[str, tuple[str, Callable[..., bytes]]] = {
    "mat": ("mat", mat), "hdf5": ("hdf5", hdf5), "MATLAB 7.3": ("mat", matlab73),
}  # fmt: skip


@pytest.mark.parametrize("kind", CONTAINERS)
def test_vectors_beside_frequencies(kind: str, tmp_path: Path) -> None:
    format_, write = CONTAINERS[kind]
    recording = opened(format_, write(f=HZ, H=TIP, coh=COHERENCE), tmp_path)
    assert not recording.series
    response, coherence = sorted(recording.functions, key=lambda one: one.kind, reverse=True)
    np.testing.assert_array_equal(response.read()[0], HZ)
    np.testing.assert_array_equal(response.read()[1], TIP)
    np.testing.assert_array_equal(coherence.read()[1], COHERENCE)
    assert (response.response, response.reference) == (coherence.response, coherence.reference) == ("H", "reference")


@pytest.mark.parametrize("kind", CONTAINERS)
def test_matrices_of_responses(kind: str, tmp_path: Path) -> None:
    """Lines by responses by references, and as MATLAB's frd has it, with the lines last."""
    format_, write = CONTAINERS[kind]
    cube = TIP[:, None, None] * RNG.normal(size=(1, 3, 2)) + BASE[:, None, None]
    for freq, values, lines in ((HZ, cube, 0), (HZ, np.moveaxis(cube, 0, 2), 2)):
        recording = opened(format_, write(freq=freq, H=values), tmp_path)
        assert {(one.response, one.reference) for one in recording.functions} == {
            (f"{i}", f"{j}") for i in (1, 2, 3) for j in (1, 2)
        }
        for one in recording.functions:
            expected = np.moveaxis(values, lines, 0)[:, int(one.response) - 1, int(one.reference) - 1]
            np.testing.assert_array_equal(one.read()[1], expected)
    recording = opened(format_, write(freq=HZ, H=cube[:, :, 0], coh=np.abs(cube[:, :, 1])), tmp_path)
    pairs = [(one.kind, one.response, one.reference) for one in recording.functions]
    assert sorted(pairs) == sorted(
        [("frequency response", f"{i}", "reference") for i in (1, 2, 3)]
        + [("coherence", f"{i}", "reference") for i in (1, 2, 3)]
    )


@pytest.mark.parametrize(
    ("unit", "factor"), [(None, 2 * np.pi), ("rad/TimeUnit", 2 * np.pi), ("Hz", 1.0), ("kHz", 1e-3)]
)
def test_a_structure_like_frd_of_matlab(unit: str | None, factor: float, tmp_path: Path) -> None:
    values = np.stack([TIP, BASE])[:, None, :]
    told = {} if unit is None else {"FrequencyUnit": unit}
    recording = opened("mat", mat(g={"ResponseData": values, "Frequency": factor * HZ, **told}), tmp_path)
    for one in recording.functions:
        frequency, read = one.read()
        np.testing.assert_allclose(frequency, HZ, rtol=1e-14)
        np.testing.assert_array_equal(read, values[int(one.response.removeprefix("ResponseData(").rstrip(")")) - 1, 0])
    assert len(recording.functions) == 2


def test_structures_keep_their_own_frequencies_and_times(tmp_path: Path) -> None:
    time = np.arange(300) / 100
    content = mat(
        a={"f": HZ, "H": TIP},
        b={"freq": HZ[:40], "H": BASE[:40]},
        run={"t": time, "x": np.sin(time), "f": np.cos(time)},
    )
    recording = opened("mat", content, tmp_path)
    assert sorted(one.count for one in recording.functions) == [40, 80]
    assert sorted(one.name for one in recording.series) == ["run.f", "run.t", "run.x"]
    np.testing.assert_array_equal(arrays(recording)["run.f"], np.cos(time))


def test_complex_numbers_without_frequencies_are_two_channels(tmp_path: Path) -> None:
    recording = opened("hdf5", hdf5(z=TIP), tmp_path)
    assert not recording.functions
    read = arrays(recording)
    np.testing.assert_array_equal(read["z (real)"] + 1j * read["z (imaginary)"], TIP)


def test_columns_of_parquet(tmp_path: Path) -> None:
    target = io.BytesIO()
    pq.write_table(pa.table({"frequency": HZ, "tip/hammer real": TIP.real, "tip/hammer imag": TIP.imag}), target)
    (one,) = opened("parquet", target.getvalue(), tmp_path).functions
    assert (one.response, one.reference) == ("tip", "hammer")
    np.testing.assert_array_equal(one.read()[1], TIP)


def touchstone(
    matrix: np.ndarray, form: str, *, option: str = "# kHz S {form} R 50", scale: float = 1e-3, head: str = ""
) -> bytes:
    """Write full matrices (lines, to, by) as the specification has them: of two ports columns first, four pairs a line."""
    ports = matrix.shape[1]
    rows = []
    for hz, values in zip(HZ, matrix, strict=True):
        ordered = (values.T if ports == 2 else values).reshape(-1)
        pairs = {
            "RI": lambda v: (v.real, v.imag),
            "MA": lambda v: (abs(v), np.degrees(np.angle(v))),
            "DB": lambda v: (20 * np.log10(abs(v)), np.degrees(np.angle(v))),
        }[form]
        cells = [" ".join(f"{x!r}" for x in map(float, pairs(value))) for value in ordered]
        each = 4 if ports <= 2 else ports
        lines = [cells[i : i + each] for i in range(0, len(cells), each)]
        rows.append(f"{float(hz * scale)!r} " + "\n".join(" ".join(line) for line in lines) + " ! a comment")
    return "\n".join(["! made here", *([head] if head else []), option.format(form=form), *rows, ""]).encode()


@pytest.mark.parametrize("form", ["RI", "MA", "DB"])
@pytest.mark.parametrize("ports", [1, 2, 3, 4])
def test_touchstone(ports: int, form: str, tmp_path: Path) -> None:
    matrix = TIP[:, None, None] * RNG.normal(size=(1, ports, ports)) + BASE[:, None, None]
    recording = opened("touchstone", touchstone(matrix, form), tmp_path)
    assert [one.name for one in recording.functions][:1] == ["S11"]
    assert len(recording.functions) == ports**2
    for one in recording.functions:
        frequency, values = one.read()
        np.testing.assert_allclose(frequency, HZ, rtol=1e-14)
        np.testing.assert_allclose(values, matrix[:, int(one.response) - 1, int(one.reference) - 1], rtol=1e-12)


def test_a_file_that_may_be_cut_says_so(tmp_path: Path) -> None:
    for format_, content in (("touchstone", b"# Hz S RI R 50\n1 2 3\n2 3 4"), ("frd", b"1 2 3\n2 3 4")):
        assert "nothing tells whether its last number is whole" in opened(format_, content, tmp_path).remarks[-1]
        assert len(opened(format_, content + b"\n", tmp_path).remarks) == 1


def test_impedances_are_in_ohm_and_noise_is_passed_over(tmp_path: Path) -> None:
    matrix = TIP[:, None, None] * np.ones((1, 2, 2))
    content = touchstone(matrix, "RI", option="# Hz Z {form} R 75", scale=1.0) + b"0.5 1 2 3 4\n1.0 1 2 3 4\n"
    recording = opened("touchstone", content, tmp_path)
    assert {(one.response_unit, one.reference_unit, one.count) for one in recording.functions} == {("V", "A", 80)}
    np.testing.assert_allclose(recording.functions[0].read()[1], 75 * TIP, rtol=1e-12)


# v1 = z11 i1 + z12 i2, v2 = z21 i1 + z22 i2: the other parameters of a two-port follow from these
IMPEDANCES = np.array([[200 + 3j, 20 - 1j], [30 + 2j, 80 - 5j]]) * (1 + 0.01 * np.arange(80))[:, None, None]
DETERMINANT = np.linalg.det(IMPEDANCES)
Z = {(i + 1, j + 1): IMPEDANCES[:, i, j] for i in range(2) for j in range(2)}
PARAMETERS = {
    "Z": (IMPEDANCES, [["VA", "VA"], ["VA", "VA"]]),
    "Y": (np.linalg.inv(IMPEDANCES), [["AV", "AV"], ["AV", "AV"]]),
    "H": ([[DETERMINANT / Z[2, 2], Z[1, 2] / Z[2, 2]], [-Z[2, 1] / Z[2, 2], 1 / Z[2, 2]]], [["VA", "VV"], ["AA", "AV"]]),
    "G": ([[1 / Z[1, 1], -Z[1, 2] / Z[1, 1]], [Z[2, 1] / Z[1, 1], DETERMINANT / Z[1, 1]]], [["AV", "AA"], ["VV", "VA"]]),
}  # fmt: skip


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("parameter", PARAMETERS)
def test_parameters_of_two_ports_are_in_ohm_and_siemens(parameter: str, version: int, tmp_path: Path) -> None:
    """Version 1 has them over those of the reference resistance, version 2 as they are."""
    found, units = PARAMETERS[parameter]
    values = found if isinstance(found, np.ndarray) else np.moveaxis(np.array(found), -1, 0)
    scale = {"VA": 1 / 75, "AV": 75.0}
    normal = np.array([[scale.get(unit, 1.0) for unit in row] for row in units])
    head = "[Version] 2.0" if version == 2 else ""
    more = "[Number of Ports] 2\n[Two-Port Data Order] 21_12\n[Reference]\n75\n75\n[Begin Information]\nmade here\n[End Information]\n[Network Data]"
    text = touchstone(
        values * (normal if version == 1 else 1.0), "RI", option=f"# Hz {parameter} {{form}} R 75", scale=1.0, head=head
    ).decode()
    if version == 2:
        text = text.replace(" R 75\n", f" R 75\n{more}\n") + "[End]\n"
    for one in opened("touchstone", text.encode(), tmp_path).functions:
        to, by = int(one.response) - 1, int(one.reference) - 1
        assert one.name == f"{parameter}{one.response}{one.reference}"
        assert one.response_unit + one.reference_unit == units[to][by]
        np.testing.assert_allclose(one.read()[1], values[:, to, by], rtol=1e-12)


@pytest.mark.parametrize("shape", ["Full", "Lower", "Upper"])
@pytest.mark.parametrize("ports", [2, 3])
def test_shapes_of_matrices_of_version_2(shape: str, ports: int, tmp_path: Path) -> None:
    values = RNG.normal(size=(HZ.size, ports, ports)) + 1j
    values = values + values.swapaxes(1, 2)
    rows = []
    for hz, one in zip(HZ, values, strict=True):
        cells = [[f"{float(v.real)!r} {float(v.imag)!r}" for v in row] for row in one]
        kept = {
            "Full": cells,
            "Lower": [row[: i + 1] for i, row in enumerate(cells)],
            "Upper": [row[i:] for i, row in enumerate(cells)],
        }
        rows.append(f"{float(hz)!r} " + "\n".join(" ".join(row) for row in kept[shape]))
    head = [
        "[Version] 2.0",
        "# Hz S RI R 50",
        f"[Number of Ports] {ports}",
        "[Two-Port Data Order] 12_21",
        f"[Matrix Format] {shape}",
    ]
    content = "\n".join(
        [
            *head,
            f"[Number of Frequencies] {HZ.size}",
            "[Reference] 50 75 0.01"[: 16 if ports == 2 else None],
            "[Network Data]",
            *rows,
            "[End]",
            "",
        ]
    )
    recording = opened("touchstone", content.encode(), tmp_path)
    assert len(recording.functions) == ports**2
    for one in recording.functions:
        np.testing.assert_array_equal(one.read()[1], values[:, int(one.response) - 1, int(one.reference) - 1])


def test_ports_of_mixed_modes_have_their_names(tmp_path: Path) -> None:
    content = b"[Version] 2.0\n# Hz S RI R 50\n[Number of Ports] 2\n[Two-Port Data Order] 12_21\n[Mixed-Mode Order] D1,2 C1,2\n[Network Data]\n1 1 0 2 0 3 0 4 0\n2 1 0 2 0 3 0 4 0\n[End]\n"
    found = {one.name: one for one in opened("touchstone", content, tmp_path).functions}
    assert set(found) == {"SD1,2,D1,2", "SD1,2,C1,2", "SC1,2,D1,2", "SC1,2,C1,2"}
    assert (found["SC1,2,D1,2"].response, found["SC1,2,D1,2"].reference) == ("C1,2", "D1,2")
    np.testing.assert_array_equal(found["SC1,2,D1,2"].read()[1], [3.0, 3.0])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"# Hz S RI R 50\n1 2 x\n", "line 2 must be numbers, got '1 2 x'"),
        (b"1 2 3\n", "must have its line of options"),
        (b"# Hz Q RI R 50\n", "line 1 must be of HZ, .* got 'Q'"),
        (b"# Hz S RI R\n1 2 3\n", "R must be followed by a resistance"),
        (b"# Hz S RI R 50\n1 2 3 4 5\n2 3 4 5 6\n", "a value for each pair of ports, got 2"),
        (b"[Matrix Format] Band\n# Hz S RI R 50\n1 2 3\n", "must be Full, Lower or Upper, got 'band'"),
        (b"# Hz H RI R 50\n1 2 3\n2 2 3\n", "H must be of 2 ports, got 1"),
        (b"# Hz S RI R 50\n", "must hold frequencies"),
    ],
)
def test_damaged_touchstone_is_refused(content: bytes, message: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=message):
        opened("touchstone", content, tmp_path)


def test_frd_of_a_loudspeaker(tmp_path: Path) -> None:
    rows = "".join(
        f"{hz!r} {db!r} {deg!r}\n" for hz, db, deg in zip(HZ.tolist(), DB.tolist(), DEG.tolist(), strict=True)
    )
    (one,) = opened("frd", f"* made here\n{rows}".encode(), tmp_path).functions
    np.testing.assert_allclose(one.read()[1], TIP, rtol=1e-12)
    with pytest.raises(FormatError, match="must hold rows of frequency"):
        opened("frd", b"nothing here\n", tmp_path)


@pytest.mark.parametrize(
    ("name", "unit", "part", "stem"),
    [
        ("H", "", "whole", "H"), ("H(:,2)", "", "whole", "H(:,2)"), ("H.re", "", "real", "H"), ("Real", "", "real", ""),
        ("Imag H", "", "imaginary", "H"), ("∠H", "", "phase", "H"), ("H", "deg", "phase", "H"), ("H", "dB", "magnitude", "H"),
        ("γ²", "", "coherence", ""), ("Coherence y/u", "", "coherence", "y/u"), ("position", "mm", "whole", "position"),
        ("image", "", "whole", "image"), ("reference", "", "whole", "reference"), ("Pxx", "", "density", ""),
    ],
)  # fmt: skip
def test_names(name: str, unit: str, part: str, stem: str) -> None:
    meaning = meaning_of(name, unit)
    assert (meaning.part, meaning.stem) == (part, stem)


def test_points_units_and_frequencies() -> None:
    assert points_of("tip over hammer") == points_of("H(tip,hammer)") == points_of("tip / hammer") == ("tip", "hammer")
    assert units_of("(m/s^2)/N") == ("m/s^2", "N")
    scales = {("f", "Hz"): 1.0, ("f", "rpm"): 1 / 60, ("w", ""): 1 / (2 * np.pi), ("F", ""): None, ("force", ""): None}
    for (name, unit), scale in scales.items():
        assert frequency_scale(name, unit) == (scale if scale is None else pytest.approx(scale, rel=1e-15))
