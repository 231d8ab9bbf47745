"""Strategies of hypothesis: command lines of wrong keys, types, sizes and names."""

from __future__ import annotations

from functools import cache

from hypothesis import strategies as st

from runner.config.compose import CONF, EARLIER, GROUPS, experiments, keys_of

NUMBERS = [
    "0", "-1", "1", "3", "1.5", "-0.0", "1e-300", "1e300", "-1e300", "1e160", "1e400", "nan", "inf",
    "-inf", ".nan", ".inf", "1e9", "1e5", "0x10", "1_000", "00", "99999999999999999999999",
    "9" * 400,
]  # fmt: skip
TEXTS = [
    "null", "true", "abc", "''", "' '", "none", "~", "???", "[]", "{}", "[1,2]", "[a,b]", "[null]",
    "[[1,2],[3]]", "{a:1}", "{_target_:os.system}", "[0,nan]", "[0.0,1e9]", "x" * 300, "../x",
    "'../x'", "'a/b'", "größe", "\u202eabc", "'\x1b[31mred'", "'[bold]x[/]'", "'-1'", "${seed}",
    "'${seed}'", "${nothing}", "'\\${seed}'", "range(3)", "choice(1,2)", "interval(0,1)", "1,2",
    "glob(*)", "sort(2,1)", "tag(log,interval(1,2))", "a=b", "a:b", "int(3)", "'%s'", "{", "]", "'",
    '"', "\\", "$", "${", "os.system", "${oc.env:HOME}", "/dev/null", "/", ".", "zoo:a/b",
]  # fmt: skip
OF_HYDRA = [
    "hydra.launcher._target_", "hydra.sweeper._target_", "hydra.sweeper", "hydra.launcher",
    "hydra.sweep.dir", "hydra.sweep.subdir", "hydra.run.dir", "hydra.job_logging", "hydra.verbose",
    "hydra.callbacks.a._target_", "hydra.job.env_copy", "hydra.job.num", "hydra.mode", "hydra",
    "hydra.sweeper.params", "hydra.sweeper.grids", "hydra.sweeper.params.seed", "hydra/launcher",
    "hydra/sweeper", "hydra/job_logging", "hydra.searchpath", "hydra.launcher.n_jobs",
]  # fmt: skip
OPTIONS = [
    "-m", "--cfg=job", "--cfg=foo", "-x", "--config-name=foo", "--config-dir=/nothing", "--help=3",
    "--package=a.b", "--info=foo", "--experimental-rerun=x", "--resolve", "--to", "--output",
    "--force", "-h", "--picture", "--config", "--", "-", "--units", "--channels", "a1=b",
]  # fmt: skip
CHEAP = ["vwnn", "linear", "two_point", "last_value", "vwnn_first_order"]
CONFIGURED = ("train", "evaluate", "predict")
LISTS = {  # first words and keys of the programs that have no config
    "live": (["listen", "replay", "RUN"], ["source", "dt", "channels", "model", "port", "units"]),
    "export": (["RUN"], ["to", "output", "run"]),
    "models.zoo": (["list", "show", "load", "publish", "verify", "card"], ["name", "licence"]),
    "data.inspect": (["RECORD", "."], ["a1", "time", "dt"]),
}
PROGRAMS = (*CONFIGURED, *LISTS)


@cache
def keys(program: str) -> list[str]:
    """Every setting of a program with a config, dotted."""
    return [key for key in keys_of(program) if "." in key or key not in GROUPS]


@cache
def choices(group: str) -> list[str]:
    """What a group of choices has."""
    if group == "experiment":
        return [path.stem for path in experiments()]
    return [path.stem for folder in (CONF, EARLIER) for path in (folder / group).glob("*.yaml")]


values = st.one_of(
    st.sampled_from(NUMBERS), st.sampled_from(TEXTS), st.text(max_size=8).filter("\0".__ne__)
)


@st.composite
def words_of(draw: st.DrawFn, program: str) -> str:
    """A word that a person, or somebody who means ill, might type."""
    value = draw(values)
    known = keys(program) if program in CONFIGURED else LISTS[program][1]
    key = draw(st.sampled_from(known))
    kind = draw(st.integers(0, 9 if program in CONFIGURED else 3))
    if kind == 0:
        return draw(st.sampled_from(OPTIONS))
    if kind == 1:
        return value
    if kind == 2:
        place = draw(st.integers(0, len(key) - 1))
        other = draw(st.sampled_from(["x", ".", "", "@", "="]))
        return f"{key[:place]}{other}{key[place + 1 :]}={value}"
    if kind == 3 and program not in CONFIGURED:
        return draw(st.sampled_from(LISTS[program][0]))
    if kind == 3:
        return f"{draw(st.sampled_from(['+', '~', '++']))}{key}={value}"
    if kind == 4:
        return f"{draw(st.sampled_from(['', '+', '~']))}{draw(st.sampled_from(OF_HYDRA))}={value}"
    if kind == 5:
        group = draw(st.sampled_from(GROUPS))
        return f"{group}={draw(st.one_of(st.just(value), st.sampled_from(choices(group))))}"
    if kind == 6:
        parent = key.rpartition(".")[0] or key
        name = draw(st.sampled_from(["foo", "_partial_", "_args_", "_target_"]))
        return f"+{parent}.{name}={value}"
    return f"{key}={value}"


@st.composite
def command_lines(draw: st.DrawFn) -> tuple[str, list[str]]:
    """A program and one to four words after it."""
    program = draw(st.sampled_from((*PROGRAMS, "train", "predict")))
    words = draw(st.lists(words_of(program), min_size=1, max_size=4))
    if program == "train" and draw(st.booleans()):
        words.insert(0, f"model={draw(st.sampled_from(CHEAP))}")
    return program, [word.replace("\0", "") for word in words]
