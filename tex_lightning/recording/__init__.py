"""From sensors to the files of a class folder: sources and writer.

A source gives samples as they come; nothing is written before a recording is whole.
"""
