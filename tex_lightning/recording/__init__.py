"""From sensors to the files of a class folder: sources, feeds, contact, level, writer.

A source gives samples as they come, a feed takes them to this thread in chunks of one length, and a
session fills a track for each sense. Nothing is written before a recording is whole.
"""
