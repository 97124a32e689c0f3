"""Builds the FMUs of fmu_src: variable table -> struct, XML, binary, zip."""
