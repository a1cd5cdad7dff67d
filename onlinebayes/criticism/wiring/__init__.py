"""The wiring check: what can be wrong between the sensors' wires and the table, and the line that puts it right."""
