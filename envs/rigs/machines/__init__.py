"""The rigs, one a file: equations, how each is driven and read, which effects may hide in it and how large."""
