"""What a robot senses in MuJoCo: ranges of a lidar."""
