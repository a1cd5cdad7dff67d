"""New logs held against a refined machine."""
