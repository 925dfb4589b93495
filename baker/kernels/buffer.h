// A buffer that keeps its memory between uses, but not its contents.
#pragma once

#include <cstddef>
#include <memory>

template <class Value> class Buffer {
public:
    // Returns room for `count` uninitialised values. The buffer never shrinks.
    Value* reserve(size_t count)
    {
        if (count > capacity) {
            data.reset(), capacity = 0; // before the allocation: never hold both
            data = std::make_unique_for_overwrite<Value[]>(count);
            capacity = count;
        }
        return data.get();
    }

    Value* get() const { return data.get(); }
    size_t byte_count() const { return capacity * sizeof(Value); }

private:
    std::unique_ptr<Value[]> data;
    size_t capacity = 0;
};
