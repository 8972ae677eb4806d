"""What layouts share: lines of text, pictures, arrays that grow, poses, intrinsics."""
