"""How a picture was taken, and which source states it: shutter, lens, profiles, logs of gyroscopes."""
