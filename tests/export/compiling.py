"""C that was exported, compiled and run on a drive."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from data.record import Drive
from export.c_source import source_of
from export.step import Step

GCC = shutil.which("gcc")
needs_gcc = pytest.mark.skipif(GCC is None, reason="gcc is not installed")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror")

MAIN = """
#include "NAME.h"
#include <stdio.h>

static double x0[N], v0[N], u[M];
static NAME m;

static void take(double *a, int count, FILE *file)
{
    if (fread(a, sizeof(double), count, file) != (size_t)count) {
        printf("too short");
    }
}

int main(void)
{
    FILE *in = fopen("in.bin", "rb"), *out = fopen("out.bin", "wb");
    int k, said = 0;

    take(x0, N, in);
    take(v0, N, in);
    take(u, INPUTS, in);
    NAME_init(&m);
    NAME_begin(&m, x0, v0, u);
    for (k = 0; k < SAMPLES; ++k) {
        if (k > 0) {
            if (HELD) {
                said |= NAME_step(&m, m.u, STEP);
                take(u, INPUTS, in);
                NAME_excite(&m, u);
            } else {
                take(u, INPUTS, in);
                said |= NAME_step(&m, u, STEP);
            }
        }
        WRITES
    }
    printf("%d", said);
    fclose(in);
    fclose(out);
    return 0;
}
"""


def built(step: Step, given: Drive, folder: Path, flags: tuple[str, ...] = ("-O2",)) -> Path:
    """A program that runs a drive. Raises where gcc has a word to say."""
    source = source_of(step, "tested", ["a test"])
    (folder / "tested.h").write_text(source.header, encoding="utf-8")
    (folder / "tested.c").write_text(source.body, encoding="utf-8")
    writes = " ".join(
        f"fwrite(m.{array}, sizeof(double), {len(names)}, out);" for array, names, _ in step.outputs
    )
    words = {
        "NAME": "tested", "SAMPLES": str(given.samples), "INPUTS": str(len(step.inputs)),
        "STEP": repr(given.dt), "HELD": str(int(given.hold == "zero_order")), "WRITES": writes,
        "x0[N]": f"x0[{len(given.x0)}]", "v0[N]": f"v0[{len(given.x0)}]",
        "u[M]": f"u[{max(len(step.inputs), 1)}]", "x0, N": f"x0, {len(given.x0)}",
        "v0, N": f"v0, {len(given.x0)}",
    }  # fmt: skip
    text = MAIN
    for word, value in words.items():
        text = text.replace(word, value)
    (folder / "main.c").write_text(text)
    assert GCC is not None
    command = [GCC, *STRICT, *flags, "tested.c", "main.c", "-lm", "-o", "tested"]
    said = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stderr
    return folder / "tested"


def run_in_c(
    step: Step, given: Drive, folder: Path, flags: tuple[str, ...] = ("-O2",)
) -> dict[str, np.ndarray]:
    """The outputs (T, ·) of a drive."""
    program = built(step, given, folder, flags)
    signals = [given.x0.numpy().ravel(), given.v0.numpy().ravel(), given.u.numpy().ravel()]
    np.concatenate(signals).tofile(folder / "in.bin")
    said = subprocess.run([program], cwd=folder, capture_output=True, text=True, check=True)
    assert said.stdout == "0", said.stdout
    table = np.fromfile(folder / "out.bin").reshape(given.samples, -1)
    ends = np.cumsum([len(names) for _, names, _ in step.outputs])
    parts = np.split(table, ends[:-1], axis=1)
    return {array: part for (array, *_), part in zip(step.outputs, parts, strict=True)}
