"""Gymnasium environments as worlds: `evaluate CKPT world=gymnasium:ID`, or a file that maps one."""
