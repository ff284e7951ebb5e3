// Which invocation of a compute shader this is, where neighbours go to different threads: llvmpipe gives each of its threads as many
// neighbouring work groups as the others, however long they take.

layout(local_size_x = 64) in;

uniform uint thread_count;
uniform uint groups_each;                 // work groups of a thread

uint interleaved_invocation() {
    uint group = (gl_WorkGroupID.x % groups_each) * thread_count + gl_WorkGroupID.x / groups_each;
    return group * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
}
