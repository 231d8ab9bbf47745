"""Files as agencies and analysers write them, made for tests: CSMIP, COSMOS, PEER, K-NET, LabVIEW.

The layouts are those of the published formats; the numbers are ours.
"""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

import numpy as np

CM = 100.0  # cm/s² in m/s²


def fixed(values: np.ndarray, width: int, decimals: int, per_line: int) -> list[str]:
    """Numbers in fixed columns, which touch where they are large."""
    cells = [f"{v:{width}.{decimals}f}"[-width:] for v in values]
    return ["".join(cells[k : k + per_line]) for k in range(0, len(cells), per_line)]


def whole(count: int, width: int, per_line: int, value: int = 0) -> list[str]:
    cells = [f"{value:{width}d}"] * count
    return ["".join(cells[k : k + per_line]) for k in range(0, count, per_line)]


def csmip_v2(channels: dict[int, tuple[str, np.ndarray]], dt: float, motions: bool = True) -> str:
    """Volume 2 of CSMIP: 25 lines of text, 100 whole and 100 real numbers, then the series [cm]."""
    lines: list[str] = []
    for number, (place, a) in channels.items():
        direction, _, location = place.partition(", ")
        text = [
            "CORRECTED ACCELEROGRAM  12345-S1234-01001.01     CSMIP  QL 01/02/20",
            "A building, made for tests", "EARTHQUAKE OF SOME DAY", "", "TRIGGER TIME UNKNOWN",
            "STATION NO. 12345", "SOMEWHERE - 6-STORY HOTEL",
            f"CHAN {number:2d}: {direction:<12} LOCATION: {location}",
        ]  # fmt: skip
        lines += text + [""] * (25 - len(text))
        lines += whole(100, 5, 16) + fixed(np.zeros(100), 10, 3, 8)
        series = [("ACCEL", "CM/SEC2", CM * a)]
        if motions:
            v = dt * np.cumsum(CM * a)
            series += [("VELOC", "CM/SEC", v), ("DISPL", "CM", dt * np.cumsum(v))]
        for kind, unit, values in series:
            lines.append(
                f"{len(values):8d} POINTS OF {kind} DATA EQUALLY SPACED AT {dt:6.3f} SEC, "
                f"IN {unit}. (8F10.3)"
            )
            lines += fixed(values, 10, 3, 8)
        lines.append(f"/&  ---------- END OF DATA FOR CHANNEL {number:2d} ----------")
    return "\n".join(lines) + "\n"


def csmip_v1(channels: dict[int, tuple[str, np.ndarray]], dt: float) -> str:
    """Volume 1 of CSMIP: 13 lines of text, 100 whole and 50 real numbers, pairs of s and g/10."""
    lines: list[str] = []
    for number, (place, a) in channels.items():
        text = [
            "UNCORRECTED ACCELEROGRAM DATA              PROCESSED: 02/28/94", "A BUILDING", "", "",
            "STATION NO. 99999", "SOMEWHERE", f"CHAN {number:2d}: {place}", "", "",
            f"NO. OF POINTS = {len(a):5d}",
            "RECORD LENGTH UNKNOWN", "UNITS OF UNCOR ACCEL ARE SEC AND G/10.   MAX = .1 G", "",
        ]  # fmt: skip
        lines += text + whole(100, 5, 16) + fixed(np.zeros(50), 10, 3, 8)
        pairs = np.stack([dt * np.arange(len(a)), 10.0 * a / 9.80665], axis=1).ravel()
        lines += fixed(pairs, 7, 3, 10)
        lines.append(f"----- END OF DATA FOR CHANNEL {number} -----")
    return "\n".join(lines) + "\n"


def cosmos(channels: dict[int, tuple[str, np.ndarray]], dt: float, variant: str = "usgs") -> str:
    """COSMOS 1.20 as USGS (8F10.5, step in ms) or CGS (1E15.6, step in s) write it."""
    lines: list[str] = []
    for number, (place, a) in channels.items():
        direction, _, location = place.partition(", ")
        text = [
            "Corrected acceleration   (Format v01.20 with 13 text lines)  Src: test",
            "Some earthquake", "Hypocenter: unknown", "Origin: unknown", "Statn No: 01- 1  Code:XX",
            "Coords: 1 2", "Recorder: none", "Rcrd start time: unknown",
            f"Sta Chan {number:3d}: {direction} (Rcrdr Chan {number:2d}) Location: {location}",
            "Raw record length = 60 sec", "Processed: Max = 1", "Record filtered below 0.1 Hz",
            "Values used when parameter or data value is unknown/unspecified:   -999 -999.0",
        ]  # fmt: skip
        reals = np.full(100, -999.0)
        reals[33] = dt
        if variant == "usgs":
            reals[61], reals[62] = 1e3 * dt, dt * len(a)
        lines += text
        lines.append(" 100 Integer-header values follow on  10 lines, Format= (10I8)")
        lines += whole(100, 8, 10, -999)
        lines.append(" 100 Real-header values follow on  20 lines, Format= (5F15.6)")
        lines += fixed(reals, 15, 6, 5)
        comments = ["| Sensor: none", "| RcrdId: none"]
        lines.append(f'{len(comments):4d} Comment line(s) follow, each starting with a "|":')
        lines += comments
        values = CM * a
        if variant == "usgs":
            shape, rows = "units=cm/s^2 (4),Format=(8F10.5)", fixed(values, 10, 5, 8)
        else:
            shape, rows = "units=cm/sec2(04),Format=(1E15.6)", [f"{v:15.6E}" for v in values]
        lines.append(f"{len(a):8d} acceleration pts, approx {dt * len(a):4.0f} secs, {shape}")
        lines += rows
        lines.append(f"End-of-data for Chan {number:2d} acceleration")
    return "\n".join(lines) + "\n"


def peer(a: np.ndarray, dt: float) -> str:
    """PEER's .AT2: four lines of header, five numbers [g] in a line."""
    rows = [f"{v:15.7E}" for v in a / 9.80665]
    lines = ["".join(rows[k : k + 5]) for k in range(0, len(rows), 5)]
    head = ["PEER NGA STRONG MOTION DATABASE RECORD", "Some event",
            "ACCELERATION TIME SERIES IN UNITS OF G",
            f"NPTS= {len(a)}, DT= {dt:.4f} SEC"]  # fmt: skip
    return "\n".join([*head, *lines]) + "\n"


def uff58(
    nodes: dict[int, np.ndarray],
    dt: float,
    binary: bool,
    names: dict[int, str] | None = None,
    along: int = 1,
) -> bytes:
    """Data sets 58, or 58b, of accelerations [m/s²] along X at some nodes, in double precision.

    names: of the responses' entities, by node; along: -1 for sensors that point against X.
    """
    out = b""
    for node, a in nodes.items():
        name = (names or {}).get(node, "NONE")
        opening = f"{58:6d}"
        if binary:
            opening += f"b{1:6d}{2:6d}{11:12d}{8 * len(a):12d}{0:6d}{0:6d}{0:12d}{0:12d}"
        text = [
            f"{-1:6d}", opening, "made for tests", "NONE", "01-Jan-20 00:00:00", "NONE", "NONE",
            f"{1:5d}{0:10d}{0:5d}{0:10d} {name:<10}{node:10d}{along:4d} {'NONE':<10}{0:10d}{0:4d}",
            f"{4:10d}{len(a):10d}{1:10d}{0.0:13.5E}{dt:13.5E}{0.0:13.5E}",
            f"{17:10d}{0:5d}{0:5d}{0:5d} {'Time':<20} {'s':<20}",
            f"{12:10d}{0:5d}{0:5d}{0:5d} {'Acceleration':<20} {'m/s^2':<20}",
            *[f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {'NONE':<20}"] * 2,
        ]  # fmt: skip
        out += ("\n".join(text) + "\n").encode()
        if binary:
            out += np.asarray(a, dtype="<f8").tobytes() + b"\n"
        else:
            rows = [f"{v:20.12E}" for v in a]
            out += "".join("".join(rows[k : k + 4]) + "\n" for k in range(0, len(a), 4)).encode()
        out += f"{-1:6d}\n".encode()
    return out


def cesmd_v2(channel: int, place: str, a: np.ndarray, dt: float, decimals: int = 5) -> str:
    """One channel as CESMD distributes it today: the header of volume 1 below a first line."""
    direction, _, location = place.partition(", ")
    text = [
        f"Corrected accelerogram   12345-N2628-22354.08   Chan {channel:2d}: {direction}   from",
        "Uncorrected Accelerogram Data             Processed: 12/20/22, XXX  xx12345h",
        "Rcrd of Tue Dec 20, 2022 02:34:01.0 PST               (Avol1 v2.0, 4/18 XXX)",
        "", "", "Station No. 12345   40.585N, 124.146W    Etna2   s/n 2628  (3 Chns of  3 at Sta)",
        "Somewhere - an Office Bldg", f"Chan {channel:2d}: {direction}          "
        + (f"Location: {location}" if location else ""),
        *[""] * 7, f" {len(a)} points of instrument- and baseline-corrected accel, veloc and displ",
        *[""] * 9,
    ]  # fmt: skip
    lines = text + whole(100, 5, 16, 3) + fixed(np.zeros(100), 10, 3, 8)
    v = dt * np.cumsum(CM * a)
    for kind, unit, u in (
        ("accel", "cm/sec2.", CM * a), ("veloc", "cm/sec. ", v),
        ("displ", "cm.     ", dt * v.cumsum()),
    ):  # fmt: skip
        lines.append(
            f"{len(a):6d} points of {kind} data equally spaced at {dt:5.3f} sec, in {unit} (8f10.5)"
        )
        lines += fixed(u, 10, decimals, 8)
    return "\r\n".join([*lines, f"/&  ---------- End of data for channel {channel:2d}", ""])


def cesmd_v1(channel: int, place: str, a: np.ndarray, dt: float) -> str:
    """Volume 1 of today: 27 lines of header, a line that announces them, then g in 8f9.6."""
    text = [
        "Uncorrected Accelerogram Data             Processed: 12/20/22, XXX",
        *[""] * 5,
        f"Chan {channel:2d}: {place}",
        *[""] * 3,
        "Units of uncor accel are g",
        "",
        "",
    ]
    lines = text + whole(100, 5, 16, 3) + fixed(np.zeros(50), 10, 3, 8)
    lines.append(f"{len(a):6d} points of accel data equally spaced at {dt:6.3f} sec, in g. (8f9.6)")
    lines += fixed(a / 9.80665, 9, 6, 8)
    return "\n".join([*lines, f"/&  ---------- End of data for channel {channel:2d}", ""])


def knet(a: np.ndarray, dt: float, direction: str = "E-W", scale: str = "3920(gal)/6182761") -> str:
    """K-NET and KiK-net: 17 lines of header, counts, eight in a line; a [m/s²]."""
    gal, _, parts = scale.partition("(gal)/")
    counts = np.round(CM * a * float(parts) / float(gal)).astype(int) + 17
    said = {
        "Origin Time": "2014/12/31 23:49:00", "Lat.": "35.785", "Long.": "139.887",
        "Depth. (km)": "84", "Mag.": "4.2", "Station Code": "XXX003", "Station Lat.": "35.7943",
        "Station Long.": "140.0564", "Station Height(m)": "28",
        "Record Time": "2014/12/31 23:50:11",
        "Sampling Freq(Hz)": f"{round(1 / dt)}Hz", "Duration Time(s)": f"{int(len(a) * dt)}",
        "Dir.": direction, "Scale Factor": scale, "Max. Acc. (gal)": "3.0",
        "Last Correction": "2014/12/31 23:50:12", "Memo.": "",
    }  # fmt: skip
    rows = ["".join(f"{n:8d} " for n in counts[k : k + 8]) for k in range(0, len(counts), 8)]
    return "\n".join([f"{key:<18}{value}" for key, value in said.items()] + rows) + "\n"


def lvm(
    channels: dict[str, np.ndarray],
    dt: float,
    units: str | None = "g",
    decimal: str = ".",
    separator: str = "Tab",
    clock: str = "One",
    segments: int = 1,
    ending: str = "\r\n",
) -> str:
    """LabVIEW's measurement file with X_Columns No, One or Multi; segments with headings each."""
    cut = {"Tab": "\t", "Comma": ","}[separator]
    count, rows = len(channels), len(next(iter(channels.values())))
    lines = ["LabVIEW Measurement", "Writer_Version{}2", "Reader_Version{}2",
             f"Separator{{}}{separator}", f"Decimal_Separator{{}}{decimal}",
             f"Multi_Headings{{}}{'Yes' if segments > 1 else 'No'}", f"X_Columns{{}}{clock}",
             "Time_Pref{}Relative", "***End_of_Header***", ""]  # fmt: skip
    lines = [line.replace("{}", cut) for line in lines]
    for segment in range(segments):
        about = {"Channels": [str(count)], "Samples": [str(rows)] * count}
        about |= {"Y_Unit_Label": [units] * count} if units else {}
        about |= {"X_Dimension": ["Time"] * count, "Delta_X": [f"{dt:.6f}"] * count}
        lines += [cut.join([key, *values]).replace(".", decimal) for key, values in about.items()]
        lines.append("***End_of_Header***")
        wide = {"Multi": ["X_Value"] * count, "One": ["X_Value"], "No": ["X_Value"]}[clock]
        names = [*wide, *channels]
        if clock == "Multi":
            names = [name for pair in zip(wide, channels, strict=True) for name in pair]
        lines.append(cut.join([*names, "Comment"]))
        for k in range(rows):
            time = f"{k * dt:.6f}" if clock != "No" else ""
            cells = [f"{(segment + 1) * u[k]:.6f}" for u in channels.values()]
            row = [time, *cells]
            if clock == "Multi":
                row = [cell for one in cells for cell in (time, one)]
            lines.append(cut.join(row + (["begun, here"] if k == 0 else [])).replace(".", decimal))
        lines.append("")
    return ending.join(lines)


def xlsx(path: Path, **sheets: list[list[object]]) -> None:
    """A workbook of numbers and text in cells, as spreadsheet programs save it."""
    start = '<?xml version="1.0" encoding="UTF-8"?>'
    office = "http://schemas.openxmlformats.org"
    main, rels = f"{office}/spreadsheetml/2006/main", f"{office}/officeDocument/2006/relationships"
    package, kind = f"{office}/package/2006", "application/vnd.openxmlformats-officedocument"
    parts = {f"xl/worksheets/sheet{k}.xml": rows for k, rows in enumerate(sheets.values(), 1)}
    overrides = "".join(
        f'<Override PartName="/{part}" ContentType="{kind}.spreadsheetml.worksheet+xml"/>'
        for part in parts
    )
    book = "".join(
        f'<sheet name="{n}" sheetId="{k}" r:id="r{k}"/>' for k, n in enumerate(sheets, 1)
    )
    links = "".join(
        f'<Relationship Id="r{k}" Type="{rels}/worksheet" Target="worksheets/sheet{k}.xml"/>'
        for k in range(1, len(sheets) + 1)
    )

    def cell(value: object) -> str:
        if value is None:
            return "<c/>"
        if isinstance(value, str):
            return f'<c t="inlineStr"><is><t>{value}</t></is></c>'
        return f"<c><v>{value!r}</v></c>"

    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("[Content_Types].xml", (
            f'{start}<Types xmlns="{package}/content-types">'
            '<Default Extension="rels" ContentType="'
            'application/vnd.openxmlformats-package.relationships+xml"/>'
            f'<Override PartName="/xl/workbook.xml" ContentType="{kind}.spreadsheetml.sheet.main'
            f'+xml"/>{overrides}</Types>'))  # fmt: skip
        archive.writestr("_rels/.rels", (
            f'{start}<Relationships xmlns="{package}/relationships"><Relationship Id="r1" '
            f'Type="{rels}/officeDocument" Target="xl/workbook.xml"/></Relationships>'
        ))  # fmt: skip
        archive.writestr("xl/workbook.xml", (
            f'{start}<workbook xmlns="{main}" xmlns:r="{rels}"><sheets>{book}</sheets></workbook>'
        ))  # fmt: skip
        archive.writestr("xl/_rels/workbook.xml.rels", (
            f'{start}<Relationships xmlns="{package}/relationships">{links}</Relationships>'
        ))  # fmt: skip
        for part, rows in parts.items():
            inner = "".join(f"<row>{''.join(map(cell, row))}</row>" for row in rows)
            archive.writestr(
                part, f'{start}<worksheet xmlns="{main}"><sheetData>{inner}</sheetData></worksheet>'
            )


def tdms(path: Path, groups: dict[str, dict[str, np.ndarray]], dt: float, unit: str = "g") -> None:
    """LabVIEW's binary file with waveforms: increments and units as properties of channels."""
    import nptdms  # type: ignore[import-untyped]

    about = {"wf_increment": dt, "unit_string": unit}
    channels = [
        nptdms.ChannelObject(group, name, u, about)
        for group, inside in groups.items()
        for name, u in inside.items()
    ]
    with nptdms.TdmsWriter(str(path)) as writer:
        writer.write_segment([nptdms.RootObject({}), *channels])


def mat_object(path: Path, name: str, kind: str) -> None:
    """MAT v5 with one object of a class of MATLAB, of which other programs see a reference."""

    def element(what: int, raw: bytes) -> bytes:
        return struct.pack("<II", what, len(raw)) + raw + bytes(-len(raw) % 8)

    texts = [element(1, word.encode()) for word in (name, "MCOS", kind)]
    flags = element(6, struct.pack("<II", 6, 0))
    inner = flags + element(5, struct.pack("<ii", 1, 1)) + element(1, b"") + element(6, bytes(4))
    opaque = element(6, struct.pack("<II", 17, 0)) + b"".join(texts) + element(14, inner)
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<HH", 0x0100, 0x4D49)
    path.write_bytes(head + element(14, opaque))
