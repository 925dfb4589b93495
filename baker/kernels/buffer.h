// A buffer that keeps its memory between uses, but not its contents. It begins at a cache line.
#pragma once

#include <cstddef>
#include <memory>
#include <new>

template <class Value> class Buffer {
public:
    // Returns room for `count` uninitialised values. The buffer never shrinks.
    Value* reserve(size_t count)
    {
        if (count > capacity) {
            data.reset(), capacity = 0; // before the allocation: never hold both
            data.reset(static_cast<Value*>(::operator new(count * sizeof(Value), LINE)));
            capacity = count;
        }
        return data.get();
    }

    Value* get() const { return data.get(); }
    size_t byte_count() const { return capacity * sizeof(Value); }

private:
    static constexpr std::align_val_t LINE{64};
    struct Free {
        void operator()(Value* data) const { ::operator delete(data, LINE); }
    };

    std::unique_ptr<Value[], Free> data;
    size_t capacity = 0;
};
