"""STEP files, read by a CAD kernel in a process of its own."""

AGAIN = "export it again, as AP203, AP214 or AP242; or export the part as STL"
COARSER = "give a larger 'deviation' under [mesh] of a model file"
SIMPLER = "export one part on its own, with simpler surfaces, or " + COARSER
