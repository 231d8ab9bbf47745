"""How do files of sensors become records? Read, named, checked for faults, mended, split."""
