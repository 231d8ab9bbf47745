"""A model leaves the house: C, FMU, OpenSees, MATLAB, ONNX, torch.export, JSON."""
