"""What is known of how a picture was taken, and from where: shutter, lens, profiles, logs of gyroscopes."""
