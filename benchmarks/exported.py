"""How fast is exported C, and how small and quick to build are its FMUs?

    python -m benchmarks.exported            # chains of 1, 3, 10 and 30 degrees of freedom
    python -m benchmarks.exported --quick    # 1 and 3, short

Element networks with hinges and units, two substeps a sample of 0.01 s, under white noise. C is
what `python -m export to=c` writes, built by gcc -O2; `compiled` is the zoo's own run of the same
drive, of many runs; `free_run` a single one, of which PyTorch composes the coefficients. Both FMUs,
2 and 3, are written and built together, for all platforms whose compilers are there. One thread,
the best of three; a row tells the largest difference of both motions, too.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
import torch

from benchmarks.table import seconds_of, show
from data.arguments import Parser
from data.record import Drive
from export.c_source import source_of
from export.fmu import write_fmus
from export.steps import step_of
from models.composition.many_runs import ManyRuns
from runner.config.command_line import command_errors
from tests.export.networks import DT, network

RUNS = 10
PROGRAM = """
#include <stdio.h>
#include <time.h>
#include "chain.h"

static double u[SAMPLES][CHAIN_INPUTS], x[SAMPLES][CHAIN_X];
static const double rest[CHAIN_X];

int main(void)
{
    static chain m;
    FILE *file = fopen("u.bin", "rb");
    size_t read = fread(u, sizeof u, 1, file);
    double best = 1e9, took;
    int k, i, turn;
    clock_t begin;

    for (turn = 0; turn < 3 && read == 1; ++turn) {
        chain_init(&m);
        chain_begin(&m, rest, rest, u[0]);
        begin = clock();
        for (k = 1; k < SAMPLES; ++k) {
            chain_step(&m, u[k], CHAIN_DT);
            for (i = 0; i < CHAIN_X; ++i) {
                x[k][i] = m.x[i];
            }
        }
        took = (double)(clock() - begin) / CLOCKS_PER_SEC;
        best = took < best ? took : best;
    }
    printf("%.9g", best);
    file = fopen("x.bin", "wb");
    fwrite(x, sizeof x, 1, file);
    fclose(file);
    return 0;
}
"""


def in_c(folder: Path, u: np.ndarray, dofs: int) -> tuple[float, np.ndarray]:
    """Seconds of a run, and its displacements (T, n)."""
    (folder / "main.c").write_text(PROGRAM)
    u.tofile(folder / "u.bin")
    words = ["gcc", "-std=c99", "-O2", f"-DSAMPLES={len(u)}", "chain.c", "main.c", "-lm"]
    subprocess.run([*words, "-o", "chain"], cwd=folder, check=True)
    said = subprocess.run([folder / "chain"], cwd=folder, check=True, capture_output=True)
    return float(said.stdout), np.fromfile(folder / "x.bin").reshape(len(u), dofs)


def row(dofs: int, samples: int) -> list[str]:
    model = network(dofs)
    step, rest = step_of(model), torch.zeros(dofs, dtype=torch.float64)
    drawn = torch.randn(samples, dofs, generator=torch.Generator().manual_seed(0)).double()
    drive = Drive(DT, 3e3 / dofs * drawn, rest, rest)
    with tempfile.TemporaryDirectory() as temporary, torch.inference_mode():
        folder, source = Path(temporary), source_of(step, "chain")
        (folder / "chain.h").write_text(source.header)
        (folder / "chain.c").write_text(source.body)
        seconds, x = in_c(folder, drive.u.numpy(), dofs)
        one = min(seconds_of(lambda: model.free_run(drive), 3))
        runs = ManyRuns(model, drive)
        theta = np.tile(runs.theta, (RUNS, 1))
        compiled = min(seconds_of(lambda: runs(theta), 3)) / RUNS
        right = model.free_run(drive).x.numpy()
        begin = time.perf_counter()
        sizes = [path.stat().st_size for path in write_fmus(step, "chain", [], folder)]
        built = time.perf_counter() - begin
    substeps = (samples - 1) * model.substeps
    apart = np.abs(x - right).max() / np.abs(right).max()
    return [
        str(dofs), f"{1e6 * seconds / substeps:.3f}", f"{seconds / compiled:.2f}",
        f"{seconds / one:.2f}", f"{apart:.1e}",
        " and ".join(f"{size / 1000:.0f}" for size in sizes), f"{built:.1f}",
    ]  # fmt: skip


def main() -> None:
    parser = Parser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--quick", action="store_true", help="1 and 3 degrees of freedom, short")
    quick = parser.parse_args().quick
    if shutil.which("gcc") is None:
        parser.error("gcc is not there; install it")
    torch.set_num_threads(1)
    sizes, samples = ((1, 3), 500) if quick else ((1, 3, 10, 30), 5000)
    head = (
        "DOFs", "µs a substep", "of compiled", "of free_run", "apart", "FMUs [kB]", "built [s]",
    )  # fmt: skip
    show("", head, (row(dofs, samples) for dofs in sizes))


if __name__ == "__main__":
    with command_errors():
        main()
