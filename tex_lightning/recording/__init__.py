"""From sensors to the files of a class folder: sources, recorder, writer.

A source gives samples as they come, and the recorder takes them to one thread, side by side.
Nothing is written before a recording is whole.
"""
