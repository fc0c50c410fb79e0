"""Laws, one file each: every module of this folder that has a `Law` is found."""
