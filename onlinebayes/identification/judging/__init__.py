"""Hypotheses evaluated: fitted, and judged by what they predict of data that were left out."""
