"""Record with sensors, sound cards and cameras into the folder of a class.

A source gives samples as they come; a file is written once a recording is complete.
"""
