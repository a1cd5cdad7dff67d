"""The colours of the recording; the page has its own in style.css, for light and dark."""

COLOURS = {
    "measured": (205, 210, 216, 110),
    "before": (255, 140, 66, 255),
    "after": (90, 170, 245, 255),
    "command": (150, 200, 140, 255),
}
"""Drawn quantity -> RGBA, for dark and light ground; Rerun draws the measured curve last, so it is translucent."""

EFFECTS = ((230, 90, 140, 255), (80, 190, 150, 255), (180, 130, 235, 255), (220, 190, 70, 255))
"""Forces of effects, in turn -> RGBA."""
