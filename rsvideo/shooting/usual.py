"""What is usual of cameras, for takes of which nobody states it."""

READOUT, READOUT_SPREAD = 0.5, 0.3  # of a frame's period: mean and deviation of readouts in the public table
MILD = 0.25  # of a frame's period: exposure of a clip whose frames show none, and readout of one whose frames are not measured, for too
# short is the milder error. Of the public table's readouts 4 % are below half of it, so that straightening by it does harm, and 20 % below
# half of READOUT
FOCAL, FOCAL_SPREAD = 0.85, 0.25  # focal length per longer side of phones and cameras, mostly 0.7 to 1.0; and of its logarithm
