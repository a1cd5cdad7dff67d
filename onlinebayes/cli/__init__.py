"""The command line: problem files in, reports out."""
