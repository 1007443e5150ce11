"""Panda3D's core, whose C++ ends the process if Ctrl-C arrives while it is imported."""

from zoo.base.run_command import held_interrupt

with held_interrupt():
    from panda3d import core

__all__ = ["core"]
