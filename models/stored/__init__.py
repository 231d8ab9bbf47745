"""What is read back of a finished run: its files, their types, its model. A zoo's entry is one."""
