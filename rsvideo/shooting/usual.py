"""What is usual of cameras, for takes of which nobody states it."""

READOUT, READOUT_SPREAD = 0.5, 0.3  # of a frame's period: mean and deviation of readouts in the public table
EXPOSURE = 0.25  # of a frame's period, where blur shows none; mild, for too short is the milder error
FOCAL, FOCAL_SPREAD = 0.85, 0.25  # focal length per longer side of phones and cameras, mostly 0.7 to 1.0; and of its logarithm
