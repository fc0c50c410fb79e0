"""Laws, a file each: a module of this folder with a `Law` in it is found by its being here."""
