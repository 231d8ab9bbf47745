"""Selection of a model: what a record is taken for, which is chosen, how its time is shared."""

from __future__ import annotations

import shlex
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from filelock import FileLock
from hydra.errors import HydraException

from data.inspect.proposal import proposal
from runner.scores.grade import BY_FREE_RUN
from runner.selection import fits
from runner.selection.candidates import candidates
from runner.selection.fits import Fits, Job
from runner.selection.identified import choose, leaves_noise, lines_of, outcome_of
from runner.selection.search import (
    NO_TIME,
    Asked,
    _data_of,
    _doubts,
    _require_understood,
    _split,
    _understood,
    _written,
    identify_records,
)
from runner.selection.words import read_words

READER = {"skip_rows": 0, "delimiter": None, "decimal": None, "group": None, "header": True}


def table(path, header, columns=3, samples=400, offset=0.0):
    t = 0.01 * np.arange(samples)
    rows = [t, *(np.sin((3.0 + i) * t) * np.hanning(samples) + offset for i in range(columns))]
    np.savetxt(path, np.stack(rows, 1), delimiter=",", header=header, comments="")
    return str(path)


def test_a_column_of_absurd_values_is_left_out_with_a_note(tmp_path):
    path = table(tmp_path / "r.csv", "time [s],ground [g],roof [g]", columns=2)
    rows = np.loadtxt(path, delimiter=",", skiprows=1) * [1.0, 1.0, 1e200]
    np.savetxt(path, rows, delimiter=",", header="time [s],ground [g],roof [g]", comments="")
    about, _ = _understood(Asked([path]))
    (file,) = about["record"]["files"]
    assert "'roof' has values beyond 1e+100, whatever its unit: left out" in file["notes"]


@pytest.mark.parametrize(("words", "told"), [([], True), (["data.dt=0.01"], False)])
def test_a_fault_that_a_word_answers_is_no_fault(tmp_path, words, told):
    path = table(tmp_path / "r.csv", "Sample,ground [g],roof [g]", columns=2)
    rows = np.loadtxt(path, delimiter=",", skiprows=1) * [100.0, 1.0, 1.0]
    np.savetxt(path, rows, delimiter=",", header="Sample,ground [g],roof [g]", comments="")
    about, _ = _understood(Asked([path], words))
    faults = [fault["what"] for fault in about["record"]["files"][0]["findings"]]
    assert ("no clock" in faults, bool(about["questions"])) == (told, told)


def test_columns_are_recognised_and_the_reason_is_said(tmp_path):
    path = table(tmp_path / "r.csv", "Time (s),Base acc (g),Floor1 acc (g),Roof acc (g)")
    found = proposal([path], {}, {}, **READER)
    assert found.columns["s_ddot1"] == "Base acc"
    assert [found.columns[c] for c in ("a1", "a2")] == ["Floor1 acc", "Roof acc"]
    assert "ground" in found.why["s_ddot1"]
    assert "unit" in found.why["a1"]
    assert not found.questions
    assert any(w.startswith("data.channels=") for w in found.words)


def test_columns_named_by_floors_get_the_setting_that_numbers_them(tmp_path):
    header = "Time (s),Ground (g),3rd floor (g),5th floor (g)"
    path, setting = table(tmp_path / "r.csv", header), []
    for numbers in ([1, 2], [3, 5]):
        about, words = _understood(Asked([path], setting, None))
        (file,) = about["record"]["files"]
        (storeys,) = (one["text"] for one in file["findings"] if one["what"] == "storeys")
        assert "some floors have no sensor" in storeys
        assert _data_of([*words, "model=linear_state_space"]).numbers == numbers
        setting = shlex.split(storeys.partition("by floors: ")[2])[:1]
    assert not setting  # once they are numbered


@pytest.mark.parametrize(
    ("header", "option"),
    [
        ("time,p,q,s", "data.channels.a1"),  # names that say nothing
        ("time,a1,a2,a3", "data.channels.s_ddot1"),  # nothing drives
        ("time,Base acc,Floor1 acc,Roof acc", "data.units.a=UNIT"),  # several fit
        ("data.time,data.base_acc,data.f1_acc,data.roof_acc", "data.units.a=UNIT"),  # of a struct
    ],
)
def test_what_is_missing_is_asked_for_by_its_option(tmp_path, header, option):
    found = proposal([table(tmp_path / "r.csv", header)], {}, {}, **READER)
    assert any(said.startswith(option) for _, said in found.questions)


@pytest.mark.parametrize("force", [False, True])
def test_offsets_of_accelerations_are_removed_where_nothing_else_may_have_a_mean(tmp_path, force):
    header = "time,f1,a1,a2" if force else "time,s_ddot1,a1,a2"
    path = table(tmp_path / "r.csv", header, offset=0.5)
    found = proposal([path], {}, {}, **READER)
    assert ("data.mend.detrend=mean" in found.words) == (not force)
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    still = np.column_stack([0.01 * np.arange(400), np.full((400, 3), 0.5)])
    rows[:, 0] += 4.0
    np.savetxt(path, np.vstack([still, rows]), delimiter=",", header=header, comments="")
    assert "data.mend.detrend=mean" not in proposal([path], {}, {}, **READER).words  # data.onset


def test_an_answer_leaves_the_rest_as_it_was_recognised(tmp_path):
    path = table(tmp_path / "r.csv", "Time (s),A0 (g),A1 (g),A2 (g)")
    assert proposal([path], {}, {}, **READER).questions
    found = proposal([path], {"s_ddot1": "A0"}, {}, **READER)
    assert found.columns == {"time": "Time", "a1": "A1", "a2": "A2", "s_ddot1": "A0"}
    assert not found.questions
    assert "its unit" in found.why["a1"]
    whole = proposal([path], {"s_ddot1": "A0", "a1": "A2"}, {}, **READER)
    assert whole.columns == {"time": "Time", "s_ddot1": "A0", "a1": "A2"}


def test_any_setting_that_a_question_names_answers_it(tmp_path):
    path = table(tmp_path / "r.csv", "time,s_ddot1,a1,a2")
    head, *rows = (tmp_path / "r.csv").read_text().splitlines()
    (tmp_path / "r.csv").write_text("\n".join([head, *rows[:200], *rows, ""]))  # it restarts
    assert [one["option"] for one in _understood(Asked([path]))[0]["questions"]] == ["data.start"]
    for words in (["data.dt=0.01"], ["data.dt=0.01", "data.channels.a1=a2"]):
        assert not _understood(Asked([path], words))[0]["questions"]


@pytest.mark.parametrize(("lost", "repaired"), [(3, True), (180, False)])
def test_a_gap_of_more_than_half_a_period_is_asked_about(tmp_path, lost, repaired):
    path = table(tmp_path / "r.csv", "time,s_ddot1,a1,a2", samples=900)
    head, *rows = (tmp_path / "r.csv").read_text().splitlines()
    (tmp_path / "r.csv").write_text("\n".join([head, *rows[:300], *rows[300 + lost :], ""]))
    found = proposal([path], {}, {}, **READER)
    assert any(word.startswith("data.mend.fill") for word in found.words) == repaired
    assert [option for _, option in found.questions] == ([] if repaired else ["data.start=4.8"])


def test_records_with_other_columns_are_no_records_of_one_structure(tmp_path):
    paths = [
        table(tmp_path / "p.csv", "time,s_ddot1,a1,a2"),
        table(tmp_path / "q.csv", "time,s_ddot1,a1", 2),
    ]
    ((text, option),) = proposal(paths, {}, {}, **READER).questions
    assert "p.csv" in text
    assert option == "data.channels.a1=COLUMN"


@pytest.mark.parametrize(
    ("channels", "states", "first", "never"),
    [
        (["s_ddot1", "a1", "a2"], "", "linear_state_space", "linear"),
        (["f1", "a1", "x1", "v1"], "xv", "linear_state_space", "element_test, named"),
        (["s1", "r1"], "", "restoring_force_surface, order 1", "vwnn"),
        (["u1", "x1"], "", "linear_state_space", "element_network, units"),
    ],
)
def test_candidates_follow_the_kind_of_record_and_plain_ones_come_first(
    channels, states, first, never
):
    names = [one.name for one in candidates(channels, 0.01, states)]
    assert names[0] == first
    assert never not in names
    assert len({one.folder for one in candidates(channels, 0.01, states)}) == len(names)


def test_without_rates_an_element_has_no_model_that_needs_them():
    """A cyclic test without a clock: all others refuse a rate that is zero throughout."""
    names = [one.name for one in candidates(["s1", "r1"], 0.01, rates=False)]
    assert names == ["element_test, named", "element_test, units"]


def test_a_word_that_no_model_has_is_refused():
    tried = [{"name": "fir", "words": ["model=fir"]}]
    _require_understood(Asked([], ["data.dt=1"]), tried)
    with pytest.raises(ValueError, match=r"model\.nosuch=3 is a setting of none"):
        _require_understood(Asked([], ["model.nosuch=3"]), tried)
    for word in ("model=fir", "model.laws=named"):
        with pytest.raises(ValueError, match=rf"{word} is one model of several"):
            _require_understood(Asked([], [word]), [{**tried[0], "words": [word]}])


def test_words_about_a_model_are_for_those_that_have_the_setting():
    """Beside words about the data that a candidate has itself."""
    asked = Asked([], ["model.masses=[1,1]", "data.dt=1"])
    tried = candidates(["f1", "a1", "x1", "v1"], 0.01, "xv")
    told = {one.name: asked.of(one) for one in tried}
    assert told["element_network, named"] == ["model.masses=[1,1]"]
    assert list(told).index("element_network, named") < list(told).index("element_network, units")
    assert told["fir"] == []


def test_the_first_part_of_a_record_is_no_test_motion(tmp_path):
    path = table(tmp_path / "r.csv", "time,f1,a1", 2)
    data = _data_of(["data=measured", f"data.path={path}", "model=fir", "data.run_in=true"])
    assert data.records["test"][0].samples == 400
    assert _split(data).endswith(", 2 s")


def test_filters_are_as_fast_as_the_samples():
    slow = candidates(["f1", "a1"], 0.2)
    assert "model.cutoff=5" in next(one for one in slow if one.name == "vwnn").words


def test_the_same_data_are_read_once_and_their_opponents_identified_once(tmp_path, monkeypatch):
    words = ["data=measured", f"data.path={table(tmp_path / 'r.csv', 'time,f1,a1,a2')}"]
    words += ["model=vwnn_first_order", "figures=false"]
    first = fits.fit(words, str(tmp_path / "a"))["metrics"]
    monkeypatch.setattr("data.measured.reading.read_table", None)
    monkeypatch.setattr("models.linear_state_space.LinearStateSpace.identify", None)
    second = fits.fit(words, str(tmp_path / "b"))["metrics"]
    assert first["baselines"] == second["baselines"] != {}
    assert first["test"] == second["test"]


def outcome(blocks, parameters, way="free run", grade="simulates the structure", **more):
    told = {"grade": grade}
    errors = {way: blocks} if blocks else {}
    return {"way": way, "blocks": errors, "parameters": parameters, "grade": told, **more}


def test_the_fewest_parameters_within_a_standard_error_are_chosen_whatever_the_test_says():
    spread = np.array([0.9, 1.1, 1.0, 0.8, 1.2])
    few = outcome((0.0101 * spread[::-1]).tolist(), 5, test_percent=50.0)
    many = outcome((0.01 * spread).tolist(), 500, test_percent=1.0)
    worse = outcome((0.05 * spread).tolist(), 2, test_percent=0.1)
    assert choose([worse, many, few]) == 2
    assert choose([worse, many]) == 1
    assert choose([outcome(None, 3)]) is None


def test_a_simulation_that_is_unstable_is_not_chosen():
    held = {"free run": {"blocks": [0.01] * 5, "noise_percent": 1.0}}
    verdict = {"by": "free run", "unstable": "", "held_back": held, "grade": {"grade": ""}}
    metrics = {"free_run": {}, "parameters": 5, "verdict": verdict}
    grows = metrics | {"verdict": verdict | {"unstable": "its free run grows without end"}}
    assert choose([outcome_of(grows)]) is None
    assert choose([outcome_of(grows), outcome_of(metrics)]) == 1
    assert outcome_of(grows)["held_back_percent"] == pytest.approx(10.0)
    assert outcome_of(grows)["reason"] == "its free run grows without end"


def test_one_step_ahead_is_chosen_where_no_simulation_is_one():
    poor = outcome([0.9, 0.8, 0.95, 0.9, 0.7], 9, grade="not identified")
    ahead = outcome([0.01] * 5, 50, "one step", "estimates one step ahead only")
    assert choose([poor, ahead]) == 1
    assert choose([poor | {"grade": {"grade": "simulates the structure"}}, ahead]) == 0


def test_a_search_ends_where_nothing_but_noise_is_left():
    noisy = {"blocks": {"free run": [0.011, 0.01, 0.0095, 0.0105, 0.009]}}
    assert leaves_noise(noisy | {"noise_percent": 10.0})
    assert not leaves_noise(noisy | {"noise_percent": 9.5})  # by three standard errors
    assert not leaves_noise({"blocks": {"one step": [0.01] * 5}, "noise_percent": 10.0})


def test_a_linear_model_that_was_trained_one_step_ahead_may_simulate():
    network = outcome([1e-6] * 5, 59)
    linear = outcome([1e-12] * 5, 10) | {"way": "one step"}
    assert choose([network, linear]) == 1


def run(monkeypatch, seconds, end, wanted=lambda number: True, count=2, beside=0.0, seldom=()):
    """Jobs that fit for so many seconds: which ended, and the budgets they were given."""
    budgets, ended = {}, []

    def fit(words, folder):
        budgets[int(words[0])] = float(words[1].partition("=")[2])
        time.sleep(own := seconds[int(words[0])])
        return {"metrics": {"fit_seconds": own}, "seconds": own + beside}

    class Pool(ThreadPoolExecutor):
        def shutdown(self, **_):
            super().shutdown(wait=False)

    monkeypatch.setattr(fits, "fit", fit)
    monkeypatch.setattr(Fits, "_process", lambda self: Pool(1))
    jobs = [Job(i, [str(i)], "", seldom=i in seldom) for i in range(len(seconds))]
    side_by_side = Fits(count)
    for look in side_by_side.run(jobs, time.monotonic() + end, wanted):
        ended.extend(look.ended)
    side_by_side.close()
    return ended, budgets


@pytest.mark.parametrize(("count", "shares"), [(1, [0.5, 0.5, 1.0]), (2, [1.0, 0.5, 1.0])])
def test_half_of_the_time_is_left_unless_a_process_has_later_models(monkeypatch, count, shares):
    ended, budgets = run(monkeypatch, [0.3, 0.1, 0.1], 20.0, count=count)
    assert sorted(ended) == [0, 1, 2]
    assert [budgets[i] / 20.0 for i in range(3)] == pytest.approx(shares, rel=0.1)


def test_less_time_is_left_for_models_that_are_seldom_the_best(monkeypatch):
    _, budgets = run(monkeypatch, [0.1] * 3, 20.0, count=1, seldom=(2,))
    assert [budgets[i] / 20.0 for i in range(3)] == pytest.approx([0.5, 0.75, 1.0], rel=0.1)


@pytest.mark.parametrize(("end", "share"), [(90.0, 25.0), (70.0, 50.0)])
def test_a_model_leaves_the_next_as_much_unless_that_were_not_begun(monkeypatch, end, share):
    _, budgets = run(monkeypatch, [0.01] * 3, end, count=1, beside=20.0)
    assert budgets[1] == pytest.approx(share, rel=0.05)


def test_a_model_of_seconds_is_begun_though_the_first_of_a_process_took_long(monkeypatch):
    def fit(words, folder):
        taken = 40.0 if words[0] == "0" else 1.0
        return {"metrics": {"fit_seconds": 0.5}, "seconds": 0.5 + taken}

    monkeypatch.setattr(fits, "fit", fit)
    monkeypatch.setattr(Fits, "_process", lambda self: ThreadPoolExecutor(1))
    jobs = [Job(i, [str(i)], "", quick=i in (1, 3)) for i in range(4)]
    end = time.monotonic() + 60.0
    ended = [i for look in Fits(1).run(jobs, end, lambda number: True) for i in look.ended]
    assert ended == [0, 1, 3]


@pytest.mark.parametrize(("quick", "begun"), [((0, 1, 2), [0, 1]), ((2,), [2]), ((), [])])
def test_a_plain_model_is_fitted_however_little_time_is_left(monkeypatch, quick, begun):
    """The first has no result; what others take longer than the time is theirs until one has."""

    def fit(words, folder):
        time.sleep(0.7)
        failed = {"failed": "no", "seconds": 0.7}
        return failed if words[0] == "0" else {"metrics": {"fit_seconds": 0.1}, "seconds": 0.7}

    monkeypatch.setattr(fits, "fit", fit)
    monkeypatch.setattr(Fits, "_process", lambda self: ThreadPoolExecutor(1))
    jobs = [Job(i, [str(i)], "", quick=i in quick) for i in range(3)]
    end = time.monotonic() - 1.0
    assert [i for look in Fits(1).run(jobs, end, lambda number: True) for i in look.ended] == begun


def test_a_model_that_overstays_is_left_and_what_cannot_win_is_not_begun(monkeypatch):
    begun = time.monotonic()
    ended, budgets = run(monkeypatch, [0.01, 0.01, 3.0], 0.6, lambda number: number != 1, 1)
    assert ended == [0]
    assert sorted(budgets) == [0, 2]
    assert time.monotonic() - begun < 2.5


def test_faults_of_channels_in_use_are_advice_where_they_were_not_repaired(tmp_path):
    channels = [{"channel": "a1", "column": "Acc"}, {"channel": None, "column": "T"}]
    kinds = (("saturation", "Acc"), ("delay", "a1, a2"), ("drift", "T"), ("offset", "Acc"))
    faults = [{"what": what, "channel": c, "blocks": False} for what, c in kinds]
    advice = list(_doubts([{"channels": channels, "findings": faults}] * 2))
    assert advice == [f"look at the {x}, see above" for x in ("saturation in Acc", "delay in a1")]
    about = {"record": {"files": [{"channels": channels, "findings": faults}]}, "questions": []}
    assert _written(tmp_path, about, [], [], 0.0, None).verdict["advice"] == advice


def test_time_is_advised_where_models_had_none_and_no_model_that_is_tried_anyway(tmp_path):
    """By the grade of one trained one step ahead, a simulator would help: others were tried."""
    own = {"grade": "estimates one step ahead only", "reason": "", "advice": [BY_FREE_RUN, "rest"]}
    late = {"name": "modal_network", "status": "not tried", "reason": NO_TIME}
    about = {"record": {"files": []}, "questions": [], "verdict": own}
    written = _written(tmp_path, about, [late], [], 0.0, None)
    assert written.verdict["advice"] == ["more time: a larger budget=", "rest"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([""], "name of a record is empty"), (["README.mb"], "did you mean 'README.md'"),
        (["no/*.csv"], "nor does its folder"), (["budget=9s"], "name the record"),
        (["README.md", "model.masses=[1,2"], "no viable alternative"),
        (["README.md", "model.masses=1,2"], r"a list is model\.masses=\[1,2\]"),
        (["README.md", "hydra.mode=MULTIRUN"], "setting of identify.py, which has no sweeps"),
    ],
)  # fmt: skip
def test_words_that_cannot_be_meant_are_reported_before_anything_is_loaded(words, message):
    with pytest.raises((ValueError, HydraException), match=message):
        read_words(words)


@pytest.mark.parametrize("held", [True, False])
def test_a_folder_that_is_in_use_or_no_folder_is_left_as_it_is(tmp_path, held):
    path = table(tmp_path / "r.csv", "time [s],ground [g],roof [g]", columns=2, samples=900)
    folder = tmp_path / "out"
    if held:
        folder.mkdir()
    else:
        folder.write_text("mine")
    processes = SimpleNamespace(close=lambda: None)
    message = "is in use by .*choose another hydra.run.dir" if held else "cannot be written: File"
    with (
        FileLock(folder / ".lock") if held else nullcontext(),
        pytest.raises(ValueError, match=message),
    ):
        identify_records(path, folder, 9.0, fits=processes)
    assert folder.is_file() or not (folder / "identify.json").exists()


def test_a_search_that_is_lost_leaves_no_result_of_an_earlier_one(tmp_path):
    """Whose runs it has begun to replace by those of other records."""

    def lost(*_):
        raise RuntimeError

    for name in ("identify.json", "report.html"):
        (tmp_path / name).write_text("{}")
    path = table(tmp_path / "r.csv", "time [s],ground [g],roof [g]", columns=2, samples=900)
    with pytest.raises(RuntimeError):
        identify_records(path, tmp_path, fits=SimpleNamespace(run=lost, close=lambda: None))
    assert sorted(place.name for place in tmp_path.iterdir()) == ["r.csv"]


def test_what_ctrl_c_ended_is_not_said_to_be_ended_by_the_budget(tmp_path):
    one = {"status": "given up", "name": "a", "reason": "interrupted", "parameters": 1}
    run = {**outcome([1.0] * 5, 3), "status": "fitted", "name": "b", "reason": "", "words": []}
    told = {"grade": "simulates the structure", "reason": "", "advice": []}
    about = {"record": {"files": []}, "questions": [], "verdict": told}
    lines = " ".join(_written(tmp_path, about, [run, one], [], 0.0, None).found["lines"])
    assert "interrupted: a" in lines
    assert "budget" not in lines.partition("Model:")[2].partition("What")[0]


def test_a_verdict_is_at_most_twelve_lines_of_eighty_columns():
    told = {"grade": "not identified", "reason": "word " * 300, "advice": ["more"] * 20}
    lines = lines_of(told, {"name": "fir", "parameters": 3}, "")
    assert len(lines) <= 12
    assert max(map(len, lines)) <= 80


def test_a_model_that_did_better_on_test_motion_stands_for_none():
    beaten = outcome([1.0] * 5, 3, grade="not identified")
    plain = outcome([1.2] * 5, 9)
    ahead = outcome([0.1] * 5, 9, way="one step", grade="estimates one step ahead only")
    assert choose([beaten, plain]) == 0
    assert choose([beaten, plain, ahead]) == 2
