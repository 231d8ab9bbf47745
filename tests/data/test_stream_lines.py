"""Lines of text as samples: formats, faults, clocks, sockets; nothing in them is executed."""

from __future__ import annotations

import io
import json
import math
import socket
import threading
import time

import pytest
import torch

from data.measured.datamodule import WholeRecords
from data.measured.mend import Mending
from data.record import Record
from data.simulation.scenario import FullState
from data.stream import AGREEING, LONGEST, SampleLines, TimeStamps, one_client, paced

DT = 0.01
HEADER = "t,f1,a1,a2"
ROWS = ["0.00,1.0,0.1,0.2", "0.01,2.0,0.3,0.4", "0.02,3.0,0.5,0.6"]


def read(text: str | bytes, **choices) -> SampleLines:
    data = text if isinstance(text, bytes) else text.encode()
    return SampleLines(io.BytesIO(data), DT, **choices)


def csv(*rows: str, header: str = HEADER) -> str:
    return "\n".join([header, *rows]) + "\n"


def same(u: torch.Tensor | None, v: list[float]) -> bool:
    wanted = torch.tensor(v, dtype=torch.float64)
    return u is not None and torch.equal(torch.nan_to_num(u, 9e9), torch.nan_to_num(wanted, 9e9))


def test_columns_are_channels_and_others_are_left_out():
    lines = read(csv("7,0.00,0.2,1.0,0.1", "8,0.01,0.4,2.0,0.3", header="packet,time,a2,f1,a1"))
    assert (lines.sensors.dofs, lines.sensors.inputs, lines.sensors.forced) == (2, 1, [1])
    samples = [sample for _, sample in lines]
    assert [s.time for s in samples] == pytest.approx([0.0, 0.01])
    assert same(samples[1].f, [2.0])
    assert same(samples[1].a, [0.3, 0.4])


@pytest.mark.parametrize("keys", ["arrays", "names"])
def test_json_lines_are_the_samples_of_csv(keys):
    rows = [[float(cell) for cell in row.split(",")] for row in ROWS]
    if keys == "arrays":
        objects = [{"t": t, "f": [f], "a": a} for t, f, *a in rows]
    else:
        objects = [{"sensor": "x", "time": t, "f1": f, "a1": a, "a2": b} for t, f, a, b in rows]
    from_json = [s for _, s in read("\n".join(map(json.dumps, objects)))]
    from_csv = [s for _, s in read(csv(*ROWS))]
    assert len(from_json) == len(from_csv) == 3
    for one, other in zip(from_json, from_csv, strict=True):
        assert torch.equal(one.f, other.f)
        assert torch.equal(one.a, other.a)
        assert one.time == other.time


def test_a_missing_value_is_nan_and_keeps_its_place():
    _, second, third = (s for _, s in read(csv(ROWS[0], "0.01,,0.3,NaN", "0.02,3.0,,0.6")))
    assert same(second.f, [math.nan])
    assert same(second.a, [0.3, math.nan])
    assert same(third.a, [math.nan, 0.6])
    text = '{"t":0,"f":[1],"a":[1,2]}\n{"t":0.01,"f":[1],"a":[null,2]}\n{"t":0.02,"f":[1]}\n'
    samples = [s for _, s in read(text)]
    assert same(samples[1].a, [math.nan, 2.0])
    assert same(samples[2].a, [math.nan, math.nan])


def test_a_shaken_base_is_what_the_batch_reader_makes_of_it(tmp_path):
    """To the last bit: relative motions, driven by −s̈; units and columns as there."""
    rng = torch.Generator().manual_seed(0)
    values = torch.randn(50, 4, generator=rng, dtype=torch.float64)
    rows = [",".join(map(repr, [round(DT * k, 9), *row])) for k, row in enumerate(values.tolist())]
    path = tmp_path / "frame.csv"
    path.write_text(csv(*rows, header="t,s_ddot1,a1,a2,a3"))
    units = {"a": "g", "s_ddot": "g"}
    data = WholeRecords(str(path), FullState(), Mending(), units=units)
    (record,) = data.records["train"]
    lines = read(path.read_bytes(), units=units)
    samples = [sample for _, sample in lines]
    assert (lines.sensors.forced, data.forced) == ("base", "base")
    assert torch.equal(torch.stack([s.f for s in samples]), record.f)
    assert torch.equal(torch.stack([s.a for s in samples]), record.a)


BAD = {
    "0.01,2.0,0.3": "3 cells, expected 4",
    "0.01,2.0,0.3,0.4,0.5": "5 cells, expected 4",
    "0.01,2.0,oops,0.4": "'oops' is no number",
    "0.01,2.0,__import__('os').abort(),0.4": "is no number",
    "0.01,2.0,1_000,0.4": "'1_000' is no number",
    "0.01,2.0,0x10,0.4": "is no number",
    '0.01,2.0,"0.3",0.4': "is no number",
    "0.01,2.0," + "1" * 5000 + ",0.4": "is no number",
    "\udc80,2.0,0.3,0.4": "codec can't decode",
}


@pytest.mark.parametrize("bad", BAD)
def test_a_bad_line_is_counted_named_and_left_out(bad):
    text = csv(ROWS[0], bad, "", ROWS[2]).encode(errors="surrogateescape")
    lines = read(text)
    assert [round(s.time, 6) for _, s in lines] == [0.0, 0.02]
    assert lines.bad == 1
    (fault,) = lines.faults
    assert fault.startswith("line 3: ")
    assert BAD[bad] in fault
    assert len(fault) < 200


BAD_JSON = ["[0.01]", "{", '{"t":0.01,"a":["x",1]}', '{"a":[true,1]}', '{"a":{}', "[" * 50_000]
BAD_JSON += ['{"a":' + "[" * 50_000, '{"a":[1' + "0" * 400 + ",1]}", '{"a":' + "9" * 6000 + "}"]


@pytest.mark.parametrize("bad", BAD_JSON, ids=range(len(BAD_JSON)))
def test_a_bad_line_of_json_is_survived(bad):
    good = '{"t":%s,"f":[1],"a":[1,2]}'
    lines = read("\n".join([good % 0.0, bad, good % 0.02]))
    assert len(list(lines)) == 2
    assert lines.bad == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "ended before its first line"),
        ("\n\n", "ended before its first line"),
        (csv(*ROWS, header="t,f1,b1,b2"), "expected accelerations a1"),
        (csv(*ROWS, header="t,g1,a1,a2"), "expected forces f1"),
        (csv(*ROWS, header="t,a1,s1,s3"), "expected s1, … without a gap"),
        (csv(*ROWS, header="t,f1,a1,a1"), "two columns of the input are both a1"),
        (csv(*ROWS, header="t,f1,a1,s_ddot1"), "base excitation takes s_ddot1"),
        (csv(*ROWS, header=ROWS[0]), "the first line holds numbers"),
        ('{"t": 0, "f": [1]}', "expected accelerations"),
        ('{"t": 0, "f": [1', "no JSON object"),
        ("x" * (LONGEST + 1), f"line 1 of the input is longer than {LONGEST} bytes"),
    ],
)
def test_what_cannot_be_a_source_is_said(text, message):
    with pytest.raises(ValueError, match=message):
        read(text)


def test_a_line_without_an_end_is_not_waited_for():
    lines = read(csv(ROWS[0]) + "1" * (LONGEST + 1))
    with pytest.raises(ValueError, match="line 3 of the input is longer than"):
        list(lines)


# Clocks


def times(*stamps: float | None) -> list[float]:
    time_of = TimeStamps(DT)
    return [round(time_of(stamp), 6) for stamp in stamps]


def test_a_missing_stamp_is_a_step_after_the_one_before():
    assert times(5.0, None, math.nan, 5.04, math.inf) == [0.0, 0.01, 0.02, 0.04, 0.05]
    assert times(None, 5.0, 5.01) == [0.0, 0.01, 0.02]


def test_a_clock_that_was_set_back_is_followed_after_a_while():
    stamps = TimeStamps(DT)
    for k in range(30):
        stamps(100.0 + DT * k)
    for k in range(AGREEING - 1):
        assert stamps(DT * k) == pytest.approx(0.30 + DT * k)
        assert "does not fit" in stamps.note
    assert stamps(DT * (AGREEING - 1)) == pytest.approx(0.30 + DT * (AGREEING - 1))
    assert "the clock was set, by -" in stamps.note
    assert stamps(DT * AGREEING) == pytest.approx(0.30 + DT * AGREEING)
    assert stamps.note == ""


def test_stamps_in_another_unit_are_found_out():
    stamps = TimeStamps(DT)
    with pytest.raises(ValueError, match=r"10 s apart; expected 0.01 s; say their unit"):
        [stamps(10.0 * k) for k in range(100)]


# Pace and sockets


@pytest.fixture
def half_a_second() -> Record:
    u = torch.arange(50, dtype=torch.float64)[:, None]
    return Record(DT, u, u)


@pytest.mark.parametrize(("speed", "least", "most"), [(1.0, 0.49, 2.0), (5.0, 0.098, 1.0)])
def test_a_record_takes_its_time(half_a_second, speed, least, most):
    begin = time.perf_counter()
    moments = [due for due, _ in paced(half_a_second, speed)]
    taken = time.perf_counter() - begin
    assert least < taken < most
    steps = torch.tensor(moments, dtype=torch.float64).diff()
    assert torch.allclose(steps, torch.tensor(DT / speed, dtype=torch.float64))


def test_a_client_on_loopback_is_read_and_no_second_is_let_in(capfd):
    sent = csv(*ROWS).encode()
    refused = []

    def client() -> None:
        port = None
        for _ in range(500):
            said = capfd.readouterr().err
            if "127.0.0.1:" in said:
                port = int(said.rpartition(":")[2])
                break
            time.sleep(0.01)
        with socket.create_connection(("127.0.0.1", port), timeout=5.0) as connection:
            connection.sendall(sent[:30])
            time.sleep(0.05)
            try:
                socket.create_connection(("127.0.0.1", port), timeout=1.0).close()
            except OSError:
                refused.append(True)
            connection.sendall(sent[30:])

    thread = threading.Thread(target=client, daemon=True)
    thread.start()
    with one_client(0) as file:
        samples = [s for _, s in SampleLines(file, DT)]
    thread.join(timeout=5.0)
    assert [s.time for s in samples] == pytest.approx([0.0, 0.01, 0.02])
    assert refused == [True]
