"""Networks that blurnoise ships or makes by code; they meet the harness as ONNX files with a contract."""
