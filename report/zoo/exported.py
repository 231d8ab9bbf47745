"""An entry's free run as a program of torch.export of a few kilobytes: hubconf's `exported`."""

from __future__ import annotations

import io
import lzma
from pathlib import Path

import torch
from torch.export import ExportedProgram

from export.graphs.choose import program_of
from export.run import read_exported

NAME = "exported.pt2.xz"
LARGEST = 9_900  # bytes: the zoo is to stay small
TOLD = ("stack_trace", "nn_module_stack", "source_fn_stack", "torch_fn", "from_node")


def write_exported(run: Path, folder: Path) -> None:
    """The program, packed; none of a model that has no graph or diverges, nor one too large."""
    try:
        program = program_of(read_exported(run))
    except ValueError:
        return
    packed = lzma.compress(bytes_of(program), preset=9 | lzma.PRESET_EXTREME)
    if len(packed) <= LARGEST:
        (folder / NAME).write_bytes(packed)


def bytes_of(program: ExportedProgram) -> bytes:
    """A program without the lines of code that it came from, which are most of it."""
    for module in program.graph_module.modules():
        if isinstance(module, torch.fx.GraphModule):
            for node in module.graph.nodes:
                for key in TOLD:
                    node.meta.pop(key, None)
    buffer = io.BytesIO()
    torch.export.save(program, buffer)
    return buffer.getvalue()
