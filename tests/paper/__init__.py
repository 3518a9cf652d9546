"""The paper's two problems at full size: every number of the paper beside ours."""
