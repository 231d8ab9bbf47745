"""Files as people have them, each with a kind of trouble, and what data.inspect says of each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from scipy.signal import butter, cont2discrete, dlsim, lfilter

DT, T = 0.01, 2400
Columns = Mapping[str, np.ndarray]


def shaken(seed: int = 0, samples: int = T, dt: float = DT) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations of a base and of a mass of 3 Hz and 3 % damping on it [m/s²]."""
    rng = np.random.default_rng(seed)
    t = dt * np.arange(samples)
    base = lfilter(*butter(2, [0.5, 10.0], "band", fs=1.0 / dt), rng.standard_normal(samples))
    base *= 4.0 * np.exp(-(((t - 8.0) / 6.0) ** 2))
    w, z = 2.0 * np.pi * 3.0, 0.03
    A, B = np.array([[0.0, 1.0], [-w * w, -2.0 * z * w]]), np.array([[0.0], [-1.0]])
    C = np.array([[-w * w, -2.0 * z * w]])
    system = cont2discrete((A, B, C, np.zeros((1, 1))), dt, "foh")
    return base, dlsim((*system[:4], dt), base[:, None])[1][:, 0]


def clock(samples: int = T, dt: float = DT) -> np.ndarray:
    return dt * np.arange(samples)


def table(path: Path, columns: Columns, formats: str = "%.7g", delimiter: str = ",") -> Path:
    """A text file with a header."""
    rows = np.column_stack(list(columns.values()))
    head = delimiter.join(columns)
    np.savetxt(path, rows, delimiter=delimiter, header=head, comments="", fmt=formats)
    return path


def changed(path: Path, change: Callable[[str], str]) -> Path:
    path.write_text(change(path.read_text()))
    return path


def decimal_commas(folder: Path) -> Path:
    base, roof = shaken()
    columns = {"Zeit [s]": clock(), "Table acc [g]": base / 9.80665, "Acc 1 [g]": roof / 9.80665}
    path = table(folder / "commas.csv", columns, delimiter=";")
    return changed(path, lambda text: text.replace(".", ","))


def units_row(folder: Path) -> Path:
    base, roof = shaken()
    path = table(folder / "units.csv", {"t": clock(), "gnd": 100 * base, "roof_acc": 100 * roof})
    return changed(path, lambda text: text.replace("\n", "\n[s],[gal],[gal]\n", 1))


def mixed_sampling(folder: Path) -> Path:
    base, roof = shaken()
    time = np.concatenate([clock(T // 2), clock(T // 2)[-1] + 2 * DT * np.arange(1, T // 2 + 1)])
    return table(folder / "mixed.csv", {"Time": time, "Base": base, "Roof": roof})


def wrapped_counter(folder: Path) -> Path:
    base, roof = shaken()
    ticks = (65536 - 9000 + 10 * np.arange(T)) % 65536
    return table(folder / "wrapped.csv", {"Time [ms]": ticks, "shake table": base, "Acc1": roof})


def seconds_of_a_minute(folder: Path) -> Path:
    base, roof = shaken()
    columns = {"Time [s]": (41.0 + clock()) % 60.0, "shake table": base, "Acc1": roof}
    return table(folder / "minute.csv", columns)


def day_fractions(folder: Path) -> Path:
    base, roof = shaken()
    days = 45000.25 + clock() / 86400.0
    columns = {"Time [day]": days, "Ground acc": base, "Roof acc": roof}
    return table(folder / "days.csv", columns, formats="%.12g")


def concatenated(folder: Path) -> Path:
    base, roof = shaken()
    time = np.concatenate([clock(T // 2), clock(T // 2)])
    return table(folder / "two.csv", {"Time": time, "Ground": base, "Roof": roof})


def rounded_stamps(folder: Path) -> Path:
    base, roof = shaken(dt=1.0 / 90.0)
    lost = np.delete(np.arange(T), slice(500, 503))
    columns = {"Time": lost / 90.0, "Ground": base[lost], "Roof": roof[lost]}
    return table(folder / "rounded.csv", columns, "%.2f,%.6g,%.6g")


def displacement_for_acceleration(folder: Path) -> Path:
    base, roof = shaken()
    moved = np.cumsum(np.cumsum(base)) * DT**2
    moved = lfilter(*butter(2, 0.2, "high", fs=1.0 / DT), moved)
    return table(folder / "cm.csv", {"time": clock(), "s_ddot1": 100 * moved, "a1": roof})


def relative_accelerations(folder: Path) -> Path:
    base, roof = shaken()
    return table(folder / "relative.csv", {"time": clock(), "s_ddot1": base, "a1": roof - base})


def reversed_sensor(folder: Path) -> Path:
    base, roof = shaken()
    return table(folder / "reversed.csv", {"time": clock(), "s_ddot1": base, "a1": -roof})


def quiet_start(folder: Path) -> Path:
    base, roof = shaken(samples=4800)
    rng = np.random.default_rng(1)
    early = np.arange(4800) < 800
    base, roof = (np.where(early, 0.0, np.roll(u, 700)) for u in (base, roof))
    noise = 1e-4 * rng.standard_normal((2, 4800))
    columns = {"Time": clock(4800), "Ground": base + noise[0], "Roof": roof + noise[1]}
    return table(folder / "quiet.csv", columns)


def element_test(folder: Path) -> Path:
    t = clock()
    s = 10.0 * np.sin(3.0 * t) * (1.0 + 0.02 * t)
    v = np.gradient(s, DT)
    force = 2.0 * np.tanh(v / 5.0) + 0.05 * s
    columns = {"Time (s)": t, "Displacement (mm)": s, "Velocity (mm/s)": v,
               "Acceleration (mm/s^2)": np.gradient(v, DT), "Force (kN)": force}  # fmt: skip
    return table(folder / "loops.csv", columns)


def voltage(folder: Path) -> Path:
    t = clock()
    s = 10.0 * np.sin(3.0 * t)
    volts = 1.0 + np.sign(np.sin(0.7 * t))
    force = volts * np.tanh(np.gradient(s, DT) / 5.0)
    columns = {"Time (s)": t, "Displacement (mm)": s, "Damper force (kN)": force,
               "Voltage (V)": volts}  # fmt: skip
    return table(folder / "mr_damper.csv", columns)


def hammer(folder: Path) -> Path:
    base, roof = shaken()
    moved = -1e3 * roof / (2.0 * np.pi * 3.0) ** 2  # of a mass of 1 t, but for its damping
    columns = {"Time": clock(), "Force [kN]": -base, "Acc_1": roof - base, "LVDT [mm]": moved}
    return table(folder / "hammer.csv", columns)


def one_axis_only(folder: Path) -> Path:
    base, roof = shaken()
    return table(folder / "axes.csv", {"Time": clock(), "Acc_X": base, "Acc_Y": roof})


ODD: dict[str, tuple[Callable[[Path], Path], tuple[str, ...], tuple[str, ...]]] = {
    # how it is written, words of the command line, what is said of it
    "decimal commas": (decimal_commas, ("--decimal", ","),
                       ("--channels time=Zeit s_ddot1='Table acc'",)),
    "units row": (units_row, (), ("line 2 holds units", "s_ddot1=gnd a1=roof_acc")),
    "mixed sampling": (mixed_sampling, (), ("uneven time steps", "data.mend.resample")),
    "wrapped counter": (wrapped_counter, (), ("begins again after 65.536 s, once", "dt = 0.01 s")),
    "seconds of a minute": (seconds_of_a_minute, (), ("begins again after 60 s", "dt = 0.01 s")),
    "day fractions": (day_fractions, (), ("dt = 0.01 s (100 Hz)", "s_ddot1='Ground acc'")),
    "two records in one": (concatenated, (), ("decreasing times", "the clock restarted")),
    "rounded stamps": (rounded_stamps, (),
                       ("of 3 samples (0.03333 s)", "dt = 0.0111111 s (90 Hz)")),
    "displacement in cm": (displacement_for_acceleration, (), ("looks like a displacement",)),
    "relative accelerations": (relative_accelerations, (), ("data.accelerations=relative",)),
    "reversed sensor": (reversed_sensor, (), ("points the other way",)),
    "quiet start": (quiet_start, (), ("quiet until 8",)),
    "element test": (element_test, (), ("s1=Displacement s_dot1=Velocity r1=Force",)),
    "voltage": (voltage, (), ("s1=Displacement r1='Damper force' u1=Voltage",)),
    "hammer": (hammer, (), ("f1=Force a1=Acc_1 x1=LVDT",)),
    "no excitation": (one_axis_only, (), ("nothing here drives the motion",)),
}  # fmt: skip
