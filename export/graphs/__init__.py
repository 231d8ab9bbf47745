"""Free runs as graphs of tensors: what the targets pt2 and onnx write."""
