"""Linear and static blocks in a row: their run, their derivatives, their start from spectra."""
