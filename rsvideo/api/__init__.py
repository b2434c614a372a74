"""What `import rsvideo` offers: photographs and clips as arrays, restored by the same rooms as the command.

Each public name is loaded when it is first used, so that `import rsvideo` costs next to nothing.
"""
