"""Parts of the modal network: input between samples, modes, laws, the compiled run, its start."""
