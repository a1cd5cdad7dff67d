"""The colours of the recording; the page has its own in style.css, for light and dark."""

COLOURS = {
    "measured": (205, 210, 216),
    "before": (255, 140, 66),
    "after": (90, 170, 245),
    "command": (150, 200, 140),
}
"""What is drawn -> RGB, readable on Rerun's dark and light ground."""
