"""What would the structure do under another motion? A finished run's model, put under it.

    python predict.py run=FOLDER excitation.path=other.csv
    python predict.py run=FOLDER excitation.path=quake.AT2 excitation.scale=1.5
    python predict.py run=FOLDER excitation.path=quake.csv excitation.units.s_ddot=g
    python predict.py run=zoo:element_network/bouc_wen excitation.seed=5   a published model
    python predict.py run=FOLDER excitation.events=7a             of FEMA P695, extra [earthquakes]
    python predict.py run=FOLDER excitation.events=all excitation.scale=[0.5,1,2]   many at once
    python predict.py run=FOLDER excitation.events=all excitation.scale=[0.5,1,2] \\
        samples=200 limits.drift=[0.02,0.04]    fragility curves, given what is known of the model
    python predict.py run=FOLDER excitation.seed=5 excitation.duration=60   as in training

Files are read as measured records are. The motion begins at rest. Written to the run's folder
`prediction/`, or to output=: histories, peaks and residuals, pictures.
"""

from __future__ import annotations

import hydra
from omegaconf import DictConfig

from report.commands import predict
from runner.config.command_line import one_line_errors, read_words, refusals
from runner.config.compose import CONF, prepare_hydra

prepare_hydra()


@hydra.main(version_base="1.3", config_path=str(CONF), config_name="predict")
def main(cfg: DictConfig) -> None:
    with refusals():
        predict(cfg)


def cli() -> None:
    """What the command line runs: bad input ends in one line and exit status 1."""
    with one_line_errors("predict"):
        read_words()
        main()


if __name__ == "__main__":
    cli()
