// Which invocation of a compute shader this is, where neighbours go to different threads: llvmpipe gives each of its threads as many
// neighbouring work groups as the others, however long they take.

layout(local_size_x = 64) in;

uniform uint thread_count;
uniform uint groups_each;                 // work groups of a thread

uint interleaved_group() { return (gl_WorkGroupID.x % groups_each) * thread_count + gl_WorkGroupID.x / groups_each; }

uint interleaved_invocation() { return interleaved_group() * gl_WorkGroupSize.x + gl_LocalInvocationID.x; }
