"""Films of drives, rendered by MuJoCo without a display."""
