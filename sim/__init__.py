"""The demo around `pirrht`: MuJoCo scenes and robots, the driving loop, recordings in Rerun, the command line."""
